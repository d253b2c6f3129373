"""MCKF, FP-MCS and the smoothers: against textbook twins, batch least squares, FilterPy, and the exact checks of the
paper's note.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.filters.base import Setting
from rkfbench.models import Navigation
from rkfbench.models.timed import Timed
from rkfbench.noise import Gaussian
from tests.contract import PROBLEMS
from tests.oracles.smoothing import augmented, least_squares
from tests.problems import linear_problem

INF = float("inf")
Q, R = 0.109 * np.eye(4), 2.008 * np.eye(2)
X0, P0 = np.array([1.0, 1, 0, 0]), np.diag([4.0, 4, 3, 3])
TOLD = {"x0": X0, "P0": P0, "Q": Q, "R": R}
POINT = {"at": 5, "lag": 6}


def problem(diagonal=True):
    made = linear_problem()
    return replace(made, R=np.diag([0.7, 1.1, 2.0])) if diagonal else made


def navigation(steps=60, runs=6, seed=3):
    """Measurements of the navigation model with outliers, no shots in the process."""
    rng = np.random.default_rng(seed)
    model, x = Navigation(), np.repeat(X0[:, None], runs, 1)
    y = np.empty((steps, 2, runs))
    for k in range(steps):
        x = model.f(x, k + 1) + np.sqrt(0.109) * rng.standard_normal(x.shape)
        y[k] = x[:2] + np.where(rng.random((2, runs)) < 0.2, np.sqrt(10), 0.1) * rng.standard_normal((2, runs))
    return model, y


def smooth(spec, p, keep=("cov",), **params):
    return build(spec, **params).run(p.model, p.y, keep=keep, **p.told)


@pytest.mark.parametrize("kind", ["squared", "abs", "innovation_cov"])
@pytest.mark.parametrize("covariance", ["alt", "std"])
@pytest.mark.parametrize("floor", [0.0, 0.05])
def test_mckf_equals_its_textbook_twin(kind, covariance, floor):
    p = problem()
    F, H, _ = p.model.matrices
    ours = smooth("mckf", p, sigma=1.5, kernel=kind, covariance=covariance, floor=floor)
    for run in range(p.y.shape[2]):
        for k in (1, 2, 12):
            xs, Ps = augmented(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., run], k, 0, 1.5, kind, covariance, floor)
            np.testing.assert_allclose(ours.mean[k - 1, :, run], xs[0], atol=1e-9, rtol=1e-9)
            np.testing.assert_allclose(ours.cov[k - 1, ..., run], Ps[0], atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize("start", ["j", "skip", "stale"])
@pytest.mark.parametrize("covariance", ["alt", "std"])
@pytest.mark.parametrize("sigma", [1.0, 3.0, INF])
def test_the_general_form_the_explicit_one_and_the_augmented_state_agree(start, covariance, sigma):
    p = problem()
    F, H, _ = p.model.matrices
    own = {"sigma": sigma, "covariance": covariance}
    explicit = smooth("fpmcs", p, start=start, **own, **POINT)
    general = smooth({"fixed_point": {"filter": {"use": "mckf", **own}, "start": start, **POINT}}, p)
    np.testing.assert_allclose(general.mean, explicit.mean, atol=1e-8)
    np.testing.assert_allclose(general.cov + np.zeros(5), explicit.cov + np.zeros(5), atol=1e-8)
    for name in ("prior_mean", "post_mean", "prior_cov", "post_cov"):
        np.testing.assert_allclose(general.extras[name] + np.zeros(5), explicit.extras[name] + np.zeros(5), atol=1e-8)
    for run in range(p.y.shape[2]):
        xs, Pis = augmented(
            F, H, p.Q, p.R, p.x0, p.P0, p.y[..., run], **POINT, sigma=sigma, covariance=covariance, start=start
        )
        np.testing.assert_allclose(explicit.mean[..., run], xs, atol=1e-8)
        np.testing.assert_allclose(explicit.cov[..., run if explicit.cov.shape[-1] > 1 else 0], Pis, atol=1e-8)


def test_the_kalman_smoothers_equal_batch_least_squares():
    p = problem(diagonal=False)
    F, H, _ = p.model.matrices
    ks, rts = smooth("ks", p, at=5, lag=7), smooth("rts", p)
    for run in range(p.y.shape[2]):
        x, P = least_squares(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., run], 5)
        np.testing.assert_allclose(ks.mean[-1, :, run], x, atol=1e-10)
        np.testing.assert_allclose(ks.cov[-1, ..., 0], P, atol=1e-10)
    np.testing.assert_allclose(rts.mean[4], ks.mean[-1], atol=1e-10)
    np.testing.assert_allclose(rts.cov[4], ks.cov[-1], atol=1e-10)


def test_rts_equals_filterpy():
    filterpy = pytest.importorskip("filterpy.kalman")
    p = problem(diagonal=False)
    F, H, _ = p.model.matrices
    kf, rts = smooth("kf", p), smooth("rts", p)
    theirs = filterpy.KalmanFilter(4, 3)
    theirs.F, theirs.H, theirs.Q, theirs.R = F, H, p.Q, p.R
    for run in range(p.y.shape[2]):
        x, P, _, _ = theirs.rts_smoother(kf.mean[..., run], kf.cov[..., 0])
        np.testing.assert_allclose(rts.mean[..., run], x, atol=1e-10)
        np.testing.assert_allclose(rts.cov[..., 0], P, atol=1e-10)


@pytest.mark.parametrize("sigma", [0.5, 3.0, INF])
@pytest.mark.parametrize("covariance", ["alt", "std"])
def test_lag_0_is_the_posterior_of_the_filter(sigma, covariance):
    p, own = problem(), {"sigma": sigma, "covariance": covariance}
    filt, smoother = smooth("mckf", p, **own), smooth("fpmcs", p, **own, **POINT)
    np.testing.assert_allclose(smoother.mean[0], filt.mean[4], atol=1e-10)
    np.testing.assert_allclose(smoother.cov[0], filt.cov[4] + np.zeros(5), atol=1e-10)


def test_infinite_width_is_the_kalman_filter():
    p = problem()
    np.testing.assert_allclose(smooth("mckf", p, sigma=INF).mean, smooth("kf", p).mean, rtol=1e-12, atol=1e-12)
    wrapped = smooth({"fixed_point": {"filter": {"use": "mckf", "sigma": INF}, **POINT}}, p)
    np.testing.assert_allclose(wrapped.mean, smooth("ks", p, **POINT).mean, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["fpmcs", "mckf"])
def test_the_distance_to_kalman_falls_by_100_for_each_decade_of_sigma(name):
    model, y = navigation()
    params = {"at": 20, "lag": 40} if name == "fpmcs" else {}
    limit = build(name, sigma=INF, **params).run(model, y, **TOLD).mean
    errors = [
        np.abs(build(name, sigma=sigma, **params).run(model, y, **TOLD).mean - limit).max() for sigma in (1e2, 1e3, 1e4)
    ]
    assert np.abs(np.array(errors[:-1]) / errors[1:] - 100).max() < 3


@pytest.mark.parametrize("name", ["ks", "fpmcs", "kf", "mckf"])
def test_a_known_input_leaves_no_trace_in_the_errors(name):
    """u = 0.7 in truth and filter moves both alike; a filter that ignores it has the bias of the note."""
    model, y = navigation()
    driven = Navigation(u=0.7)
    d, moved = np.zeros(4), np.empty_like(y)
    path = []
    for k in range(len(y)):
        d = driven.f(d[:, None], k + 1)[:, 0]
        path.append(d)
        moved[k] = y[k] + d[:2, None]
    params = {"at": 20, "lag": 40} if name in ("ks", "fpmcs") else {}
    plain = build(name, **params).run(model, y, **TOLD).mean
    with_u = build(name, **params).run(driven, moved, **TOLD).mean
    shift = path[19] if params else np.array(path)[:, :, None]
    np.testing.assert_allclose(with_u - (shift[None, :, None] if params else shift), plain, atol=1e-8)
    if name == "kf":
        F, H, _ = model.matrices
        P = np.eye(4)
        for _ in range(300):
            P = F @ (P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)) @ F.T + Q
        L = F @ P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        bias = np.linalg.solve(np.eye(4) - F + L @ H, driven.matrices[2])
        ignoring = build("kf").run(model, moved, **TOLD, keep=("prior_mean",)).extras["prior_mean"]
        knowing = build("kf").run(driven, moved, **TOLD, keep=("prior_mean",)).extras["prior_mean"]
        np.testing.assert_allclose((knowing - ignoring)[-1, :, 0], bias, atol=1e-6)


def test_the_two_covariances_differ_by_what_the_note_says():
    """P+(16) - P+(6) = (I - K H) P H' K' - K R K', also where weights are exactly 0."""
    p = problem()
    y = np.where(np.arange(3)[:, None] == 1, 1e4, p.y[:1])  # the second component has no weight at all
    told = {**p.told}
    alt, std = (
        build("mckf", sigma=1.0, covariance=c).run(p.model, y, keep=("cov", "prior_cov", "weight"), **told)
        for c in ("alt", "std")
    )
    _, H, _ = p.model.matrices
    for run in range(y.shape[2]):
        P, C = alt.extras["prior_cov"][0, ..., 0], np.diag(alt.extras["weight"][0, :, run])
        K = P @ H.T @ C @ np.linalg.inv(p.R + H @ P @ H.T @ C)
        assert C[1, 1] == 0.0
        expected = (np.eye(4) - K @ H) @ P @ H.T @ K.T - K @ p.R @ K.T
        np.testing.assert_allclose(alt.cov[0, ..., run] - std.cov[0, ..., run], expected, atol=1e-10)


@pytest.mark.parametrize("covariance", ["alt", "std"])
def test_without_any_weight_the_smoother_stays_and_the_filter_predicts(covariance):
    model = Navigation()
    y = np.full((1000, 2, 2), 1e8)
    estimate = build("fpmcs", sigma=0.5, covariance=covariance, at=3, lag=997).run(model, y, **TOLD)
    assert not estimate.failed.any()
    np.testing.assert_array_equal(estimate.mean, np.broadcast_to(estimate.mean[:1], estimate.mean.shape))
    np.testing.assert_array_equal(estimate.cov[-1], estimate.extras["prior_cov"][0] + np.zeros(2))
    filt = build("mckf", sigma=0.5, covariance=covariance).run(model, y, keep=("cov",), **TOLD)
    P = P0
    for k in range(1000):
        P = model.matrices[0] @ P @ model.matrices[0].T + Q
        np.testing.assert_allclose(filt.cov[k, ..., 0], P, rtol=1e-9)
    assert np.linalg.eigvalsh(filt.cov[-1, ..., 0])[0] > 0


def test_a_floor_of_0_is_no_floor():
    p = problem()
    np.testing.assert_array_equal(smooth("mckf", p, sigma=0.5, floor=0.0).mean, smooth("mckf", p, sigma=0.5).mean)
    assert np.abs(smooth("mckf", p, sigma=0.5, floor=0.05).mean - smooth("mckf", p, sigma=0.5).mean).max() > 1e-3


def test_the_closed_form_of_the_kalman_smoother():
    y = np.zeros((700, 2, 1))
    model = Navigation()
    estimate = build("ks", at=600, lag=100).run(model, y, **TOLD)
    position = [estimate.extras["prior_cov"][0, 0, 0, 0], *(estimate.cov[t, 0, 0, 0] for t in (0, 1, 10, 100))]
    velocity = [estimate.extras["prior_cov"][0, 2, 2, 0], *(estimate.cov[t, 2, 2, 0] for t in (0, 1, 10, 100))]
    np.testing.assert_allclose(position, [2.14395329, 1.03687540, 0.58993928, 0.40644095, 0.40601447], atol=1e-8)
    np.testing.assert_allclose(velocity, [0.45637802, 0.34737802, 0.23837802, 0.09105647, 0.09087281], atol=1e-8)


def test_steps_of_any_length_are_smoothed_up_to_the_last_one():
    model, y = navigation(steps=30)
    timed = Timed(replace(model, dt=0.1), np.random.default_rng(5).uniform(0.02, 0.5, 30).round(2))
    given = dict(TOLD, Q=np.stack([A * (k + 1) / 30 for k, A in enumerate([0.1 * np.eye(4)] * 30)])[..., None])
    point = {"at": 20, "lag": 10}
    ks = build("ks", **point).run(timed, y, **given)
    limit = build("fpmcs", sigma=np.inf, **point).run(timed, y, **given)
    rts = build("rts").run(timed, y, **given)
    np.testing.assert_allclose(limit.mean, ks.mean, atol=1e-9)
    np.testing.assert_allclose(limit.cov, np.broadcast_to(ks.cov, limit.cov.shape), atol=1e-9)
    np.testing.assert_allclose(ks.mean[-1], rts.mean[19], atol=1e-9)
    assert np.abs(ks.mean - build("ks", **point).run(model, y, **given).mean).max() > 1e-2


@pytest.mark.parametrize("name", ["daf", "sdf", "raf"])
@pytest.mark.parametrize("smoother", [{"rts": {}}, {"fixed_point": {"at": 4, "lag": 6}}])
def test_adaptive_filters_can_be_smoothed(name, smoother):
    experiment, world = PROBLEMS["odometers"]
    ((kind, point),) = smoother.items()
    told = experiment.told
    y, x0 = world.y[:10, :, :8], world.x0[:, :8]
    smoothed = build({kind: {"filter": name, **point}}).run(
        experiment.assumed_model, y, x0, told.P0, Q=told.Q, R=told.R
    )
    plain = build(name).run(experiment.assumed_model, y, x0, told.P0, Q=told.Q, R=told.R)
    at = 4 if point else 10
    np.testing.assert_allclose(smoothed.mean[0 if point else -1], plain.mean[at - 1], atol=1e-9)


@pytest.mark.parametrize("name", ["hkf", "aladkf", "mckf", "skf"])
def test_any_linear_filter_smooths_and_begins_at_its_own_posterior(name):
    model, y = navigation()
    plain = build(name).run(model, y, **TOLD)
    smoothed = build({"fixed_point": {"filter": name, "at": 20, "lag": 10}}).run(model, y, **TOLD)
    np.testing.assert_allclose(smoothed.mean[0], plain.mean[19], atol=1e-12)
    assert smoothed.mean.shape == (11, 4, 6)
    assert smoothed.target == 20


def test_a_missing_measurement_is_a_prediction_in_both_forms():
    p = problem()
    p.y[6] = np.nan
    p.y[7, 1, 2] = np.nan
    explicit = smooth("fpmcs", p, sigma=2.0, **POINT)
    general = smooth({"fixed_point": {"filter": {"use": "mckf", "sigma": 2.0}, **POINT}}, p)
    np.testing.assert_allclose(explicit.mean, general.mean, atol=1e-8)
    np.testing.assert_array_equal(explicit.mean[2], explicit.mean[1])  # y_7 says nothing of x_5


def test_a_lost_run_stays_alone():
    p = problem()
    base = smooth("fpmcs", p, **POINT).mean
    p.y[3, :, 1] = np.inf
    hurt = smooth("fpmcs", p, **POINT)
    assert hurt.failed.tolist() == [False, True, False, False, False]
    np.testing.assert_array_equal(hurt.mean[..., [0, 2, 3, 4]], base[..., [0, 2, 3, 4]])


def test_joseph_takes_any_robust_gain_with_the_noise_it_is_told():
    p = problem(diagonal=False)
    _, H, _ = p.model.matrices
    spec = {"moments": "linear", "weight": {"huber": {"threshold": 1.0}}}
    usual = smooth(spec, p, keep=("cov", "prior_cov", "inflation"))
    joseph = smooth({**spec, "update": "joseph"}, p, keep=("cov", "prior_cov", "inflation"))
    np.testing.assert_allclose(joseph.mean[0], usual.mean[0], atol=1e-12)
    w, V = np.linalg.eigh(p.R)
    root = V @ np.diag(np.sqrt(w)) @ V.T
    for run in range(p.y.shape[2]):
        P, Rh = joseph.extras["prior_cov"][0, ..., 0], root @ np.diag(joseph.extras["inflation"][0, :, run]) @ root
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + Rh)
        A = np.eye(4) - K @ H
        np.testing.assert_allclose(joseph.cov[0, ..., run], A @ P @ A.T + K @ p.R @ K.T, atol=1e-10)


def test_a_smoother_takes_the_point_of_the_scenario():
    setting = Setting(100, Gaussian.of(Q), Gaussian.of(R), (25, 75))
    placed = build("fpmcs").placed(setting)
    assert (placed.at, placed.lag) == (25, 75)
    own = build({"fixed_point": {"filter": "kf", "at": 30, "lag": 5}}).placed(setting)
    assert (own.at, own.lag) == (30, 5)


@pytest.mark.parametrize(
    ("params", "message"),
    [({"at": 101, "lag": 0}, "101 is not within"), ({"at": 90, "lag": 20}, "beyond the last step"), ({}, "needs `at`")],
)
def test_a_point_outside_the_run_is_said(params, message):
    with pytest.raises(SpecError, match=message):
        build("ks", **params).placed(Setting(100, Gaussian.of(Q), Gaussian.of(R)))


@pytest.mark.parametrize(
    ("name", "params"),
    [
        ("mckf", {"sigma": 0.0}),
        ("fpmcs", {"sigma": -1.0}),
        ("ks", {"at": 0}),
        ("pf", {"particles": 1}),
        ("mckf", {"floor": 1.0}),
    ],
)
def test_bad_parameters_are_said(name, params):
    with pytest.raises(SpecError, match="should be"):
        build(name, **params)


def test_a_full_matrix_keeps_the_weight_symmetric():
    """For a full R the weight is D^-1 R D^-1: the update equals that with the inflated R."""
    p = problem(diagonal=False)
    F, H, _ = p.model.matrices
    ours = smooth("mckf", p, sigma=2.0, keep=("cov", "weight"))
    P = F @ p.P0 @ F.T + p.Q
    x = F @ p.x0
    for run in range(p.y.shape[2]):
        D = np.diag(np.sqrt(ours.extras["weight"][0, :, run]))
        inflated = np.linalg.inv(D) @ p.R @ np.linalg.inv(D)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + inflated)
        np.testing.assert_allclose(ours.mean[0, :, run], x + K @ (p.y[0, :, run] - H @ x), atol=1e-8)
