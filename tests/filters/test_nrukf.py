"""The NRUKF and its companions on the falling body: the vectors of the note, limits, twins and failed runs."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.filters import build
from rkfbench.models import build as build_model
from tests.oracles import huber as oracle

BODY = build_model({"kind": "falling_body"})
R = np.array([[1e4]])
UKF, DD2 = {"moments": "unscented"}, {"moments": "divided_difference"}


def h(x):
    return BODY.h(x, 1)


def update(spec, x, P, y, **params):
    post = build(spec, **params).correct(
        BODY, np.array(x, float)[:, None], np.array(P, float)[..., None], np.atleast_2d(y), 1, R[..., None]
    )
    return post.x[:, 0], post.P[..., 0]


X, P = np.array([120000, 19000, 1e-3]), np.diag([1e5, 1e5, 1e-8])
FULL = np.array([[1e5, 4e4, 5e-3], [4e4, 1e5, 8e-3], [5e-3, 8e-3, 1e-8]])


@pytest.mark.parametrize("spec", [UKF, DD2])
def test_the_moments_of_the_range_are_those_of_the_note(spec):
    z, Szz, Pxz, hx = build(spec).moments.measure(BODY, X[:, None], P[..., None], 1)
    assert hx[0, 0] == pytest.approx(101980.390272, abs=5e-7)
    assert z[0, 0] == pytest.approx(101980.861702, abs=5e-7)
    assert Szz[0, 0, 0] == pytest.approx(3846.491662, abs=1e-6)
    assert Pxz[0, 0, 0] == pytest.approx(19611.341539, abs=1e-6)


@pytest.mark.parametrize(
    ("spec", "at_50", "at_800"),
    [
        ("ekf", (120070.8197, 72222.222), (121133.1154, 72222.222)),
        (UKF, (120070.1493, 72223.670), (121132.4044, 72223.670)),
        (DD2, (120070.1493, 72223.670), (121132.4044, 72223.670)),
        ("hukf", (120070.1516, 72222.779), (120263.7725, 93530.021)),
        ("hukf0", (120070.1516, 72222.779), (120263.7725, 93530.021)),
        ("hddf", (120070.1516, 72222.779), (120263.7725, 93530.021)),
        ("nrukf_r", (120070.1493, 72223.670), (120247.6047, 93926.595)),
        ("nrukf_y", (120070.1493, 72223.670), (120189.8300, 72223.670)),
    ],
    ids=str,
)
def test_one_update_gives_the_vectors_of_the_note(spec, at_50, at_800):
    for residual, expected in ((50, at_50), (800, at_800)):
        x, cov = update(spec, X, P, h(X) + residual)
        assert x[0] == pytest.approx(expected[0], abs=6e-5)
        assert cov[0, 0] == pytest.approx(expected[1], abs=6e-4)


@pytest.mark.parametrize(
    ("spec", "x1", "x2", "P11"),
    [
        (UKF, 298331.5581, 19872.4773, 12401.817), ("ekf", 298332.0836, 19872.2752, 12401.103),
        ("hukf", 298331.5582, 19872.4772, 12401.261),
        ("nrukf_r", 298326.7636, 19874.3213, 27261.406), ("nrukf_y", 298148.3573, 19942.9391, 12401.817),
    ],
    ids=str,
)  # fmt: skip
def test_the_first_step_of_track_gives_the_vectors_of_the_note(spec, x1, x2, P11):
    told = {"x0": [3e5, 2e4, 3e-5], "P0": np.diag([1e6, 4e6, 1e-4]), "Q": np.zeros((3, 3)), "R": R}
    truth = build_model({"kind": "falling_body"}).f(np.array([3e5, 2e4, 1e-3]), 1)
    assert h(truth)[0] + 300 == pytest.approx(222119.747206, abs=1e-6)
    keep = ("cov", "prior_mean", "prior_cov", "nu")
    result = build(spec).run(BODY, np.array([[222119.747206]]), **told, keep=keep)
    np.testing.assert_allclose(result.mean[0, :2, 0], (x1, x2), rtol=0, atol=6e-5)
    assert result.cov[0, 0, 0, 0] == pytest.approx(P11, abs=6e-4)
    if spec == UKF:
        np.testing.assert_allclose(
            result.extras["prior_mean"][0, :, 0], (298000.000019, 19999.999610, 3e-5), rtol=0, atol=1e-6
        )
        assert result.extras["prior_cov"][0, 0, 0, 0] == pytest.approx(1039999.9966, abs=6e-5)
        assert 222119.747206 - result.extras["nu"][0, 0, 0] == pytest.approx(221820.223115, abs=1e-6)


@pytest.mark.parametrize("residual", [50, 800, -3000])
@pytest.mark.parametrize(
    ("spec", "twin"),
    [
        ("hukf", lambda *a: oracle.hukf(*a)),
        ("hukf0", lambda *a: oracle.hukf(*a, unit_state=True)),
        ("nrukf_r", lambda *a: oracle.nrukf(*a)),
        ("nrukf_y", lambda *a: oracle.nrukf(*a, form="Y")),
        ("nrukf_r_it", lambda *a: oracle.nrukf(*a, passes=10)),
        ("nrukf_y_it", lambda *a: oracle.nrukf(*a, form="Y", passes=30)),
    ],
    ids=["hukf", "hukf0", "nrukf_r", "nrukf_y", "nrukf_r_it", "nrukf_y_it"],
)
def test_one_update_equals_the_textbook_twin(spec, twin, residual):
    y = h(X) + residual
    x, cov = update(spec, X, FULL, y)
    expected, expected_cov = twin(h, X, FULL, R, y)
    np.testing.assert_allclose(x, expected, rtol=1e-9)
    scale = np.sqrt(np.diag(FULL))
    np.testing.assert_allclose(cov / np.outer(scale, scale), expected_cov / np.outer(scale, scale), rtol=0, atol=1e-9)


@pytest.mark.parametrize("spec", ["nrukf_r", "nrukf_y", "nrukf_r_it", "nrukf_y_it"])
def test_without_a_threshold_the_nrukf_is_the_ukf_for_any_h(spec):
    y = h(X) + 5000
    for mine, plain in zip(update(spec, X, FULL, y, threshold=float("inf")), update(UKF, X, FULL, y), strict=True):
        np.testing.assert_allclose(mine, plain, rtol=1e-12)


@pytest.mark.parametrize("spec", ["nrukf_r", "nrukf_y"])
def test_small_residuals_leave_the_ukf_untouched(spec):
    y = h(X) + 134.4
    for mine, plain in zip(update(spec, X, FULL, y), update(UKF, X, FULL, y), strict=True):
        np.testing.assert_array_equal(mine, plain)


def test_without_a_threshold_the_hukf_is_the_ukf_only_with_the_linearisation_covariance():
    y = h(X) + 5000
    plain = update(UKF, X, FULL, y)
    repaired = update("hukf", X, FULL, y, threshold=1e12, linearisation_cov=True)
    np.testing.assert_allclose(repaired[0], plain[0], rtol=1e-11)
    np.testing.assert_allclose(repaired[1], plain[1], rtol=1e-7)
    bare = update("hukf", X, FULL, y, threshold=1e12)
    assert abs(bare[0][0] - plain[0][0]) > 1e-3


def test_swap_takes_the_mean_of_one_and_the_covariance_of_the_other():
    y = h(X) + 800
    x, cov = update({"use": "swap", "mean": "nrukf_y", "cov": "nrukf_r"}, X, FULL, y)
    np.testing.assert_array_equal(x, update("nrukf_y", X, FULL, y)[0])
    np.testing.assert_array_equal(cov, update("nrukf_r", X, FULL, y)[1])


@pytest.mark.parametrize("spec", ["hukf", "nrukf_r", "ekf"])
def test_a_run_that_leaves_the_world_fails_alone(spec):
    rng = np.random.default_rng(1)
    y = 2e5 + 100 * rng.standard_normal((30, 1, 4))
    wild = y.copy()
    wild[10, 0, 2] = 1e30
    told = {"x0": [3e5, 2e4, 3e-5], "P0": np.diag([1e6, 4e6, 1e-4]), "Q": np.zeros((3, 3)), "R": R}
    calm, result = (
        build(spec, **({} if spec == "ekf" else {"threshold": 1e12})).run(BODY, each, **told) for each in (y, wild)
    )
    assert result.failed.tolist() == [False, False, True, False] or calm.failed.any()
    assert np.isnan(result.mean[10:, :, 2]).all()
    np.testing.assert_array_equal(np.isnan(result.mean[..., [0, 1, 3]]), np.isnan(calm.mean[..., [0, 1, 3]]))
    np.testing.assert_array_equal(result.mean[..., [0, 1, 3]], calm.mean[..., [0, 1, 3]])


def test_weights_are_shown():
    y = np.array([[222119.747206], [220000.0]])
    told = {"x0": [3e5, 2e4, 3e-5], "P0": np.diag([1e6, 4e6, 1e-4]), "Q": np.zeros((3, 3)), "R": R}
    result = build("nrukf_r").run(BODY, y, **told, keep=("weight",))
    assert result.extras["weight"][0, 0, 0] == pytest.approx(1.345 / 3.0000055, rel=1e-6)
    result = build("hukf").run(BODY, y, **told, keep=("weight", "state_weight", "last_change"))
    assert result.extras["state_weight"].shape == (2, 3, 1)
