"""Filters with adaptive factors: the closed forms and example vectors of the DAF note, and their textbook twins."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.filters.adaptive import Sensors, weighted_solution
from rkfbench.filters.factors import factor, log_factor
from rkfbench.models import build as build_model
from tests.oracles import adaptive as oracle
from tests.problems import linear_problem

CAR = build_model({"kind": "odometers"})
F, H = CAR.matrices[:2]
X = np.array([100.0, 20.0])
P = np.array([[0.5, 0.1], [0.1, 0.05]])
R = np.diag([25.0, 1.0])
Q = 0.01 * np.array([[0.25, 0.5], [0.5, 1.0]])
FACTORED = {
    "sdf": {}, "raf": {}, "daf": {}, "raf_trace": {"use": "raf", "norm": "trace"},
    "daf_joint": {"use": "daf", "order": "separate"}, "daf_fused": {"use": "daf", "fuse": True},
}  # fmt: skip


def filt(name, **params):
    return build({"use": name, **FACTORED.get(name, {}), **params})


def update(name, y, x=X, P=P, **params):
    post = filt(name, **params).correct(CAR, x[:, None], P[..., None], np.array(y, float)[:, None], 1, R[..., None])
    return post.x[:, 0], post.P[..., 0], {key: value[..., 0] for key, value in post.seen.items()}


def test_the_exponential_factor_has_the_values_of_the_note():
    u = np.array([0, 1.5, 2, 2.5, 3, 4, 5, 6])
    expected = [1, 1, 0.7788007831, 0.3678794412, 0.1053992246, 0.001930454136, 4.785117e-6, 1e-6]
    np.testing.assert_allclose(factor(u, 1.5, "exp", 1e-6), expected, rtol=1e-6)
    np.testing.assert_allclose(factor(-u, 1.5, "exp", 1e-6), expected, rtol=1e-6)


def test_the_ratio_factor_is_lambda_over_u():
    np.testing.assert_allclose(factor(np.array([3.0, 1.0]), 1.5, "ratio", 1e-6), [0.5, 1.0])


def test_the_logarithm_of_a_factor_does_not_underflow():
    assert log_factor(np.array([200.0]), 2.5, "exp")[0] == pytest.approx(-(197.5**2))


@pytest.mark.parametrize(
    ("name", "y", "alpha", "beta", "x", "P11"),
    [
        ("skf", (400, 100.5), None, None, (104.1118421, 20.8223684), 0.3289474),
        ("sdf", (400, 100.5), (1e-6, 0.0261296969), 1e-6, (100.5004202, 20.1000840), 38.26764),
        ("raf", (400, 100.5), (1e-6, 1), 1, (100.1666707, 20.0333341), 0.3333333),
        ("raf_trace", (400, 100.5), (1e-6, 1), 1, (100.1666707, 20.0333341), 0.3333333),
        ("daf", (400, 100.5), (1e-6, 0.0261296969), 1, (100.0064541, 20.0012908), 0.4935518),
        ("daf_joint", (400, 100.5), (1e-6, 0.0261296969), 1e-6, (100.5004202, 20.1000840), 38.26764),
        ("daf_fused", (400, 100.5), (1e-6, 1e-6), 1e-6, (104.1118421, 20.8223684), 328947.37),
        ("skf", (104, 103.5), None, None, (101.2039474, 20.2407895), 0.3289474),
        ("sdf", (104, 103.5), (1, 0.9123491239), 5.6202255e-6, (103.5209591, 20.7041918), 1.0500227),
        ("raf", (104, 103.5), (1, 1), 0.1365685114, (102.7872186, 20.5574437), 0.7615352),
        ("raf_trace", (104, 103.5), (1, 1), 2.6664819e-5, (103.5190503, 20.7038101), 0.9614892),
        ("daf", (104, 103.5), (1, 0.9123491239), 0.1361298894, (102.7381982, 20.5476396), 0.8165872),
        ("daf_joint", (104, 103.5), (1, 0.9123491239), 0.1365685114, (102.7362381, 20.5472476), 0.8160027),
        ("daf_fused", (104, 103.5), (0.8445736849, 0.8445736849), 0.1365685114, (102.6844609, 20.5368922), 0.8684373),
        ("raf", (1100, 100.5), (1e-6, 1), 1, (100.1666800, 20.0333360), None),
    ],
)
def test_one_update_gives_the_vectors_of_the_note(name, y, alpha, beta, x, P11):
    mean, cov, seen = update(name, y)
    np.testing.assert_allclose(mean, x, rtol=0, atol=6e-8)
    if P11 is not None:
        assert cov[0, 0] == pytest.approx(P11, rel=2e-7)
    if alpha is not None:
        np.testing.assert_allclose(seen["alpha"], alpha, rtol=1e-8)
        np.testing.assert_allclose(seen["beta"], [beta], rtol=1e-7)


@pytest.mark.parametrize("name", ["skf", *FACTORED])
def test_every_filter_takes_sound_measurements_as_the_kalman_filter_does(name):
    mean, cov, seen = update(name, (102, 100.5))
    np.testing.assert_allclose(mean, (100.1907895, 20.0381579), rtol=1e-9)
    np.testing.assert_allclose(cov, [[0.3289473684, 0.0657894737], [0.0657894737, 0.0431578947]], rtol=1e-8)
    assert name == "skf" or ((seen["alpha"] == 1).all() and (seen["beta"] == 1).all())


@pytest.mark.parametrize(
    ("name", "y", "u"),
    [
        ("daf", (400, 100.5), 0.408623), ("daf_joint", (400, 100.5), 9.941949), ("daf_fused", (400, 100.5), 9.941949),
        ("sdf", (400, 100.5), 16.997759), ("sdf", (104, 103.5), 4.976944),
        ("daf", (104, 103.5), 2.912142), ("daf_joint", (104, 103.5), 2.911003), ("daf_fused", (104, 103.5), 2.911003),
    ],
)  # fmt: skip
def test_standardised_state_residuals_have_the_values_of_the_note(name, y, u):
    assert update(name, y)[2]["u_beta"][0] == pytest.approx(u, abs=1e-6)


def test_standardised_measurement_residuals_have_the_values_of_the_note():
    np.testing.assert_allclose(update("daf", (400, 100.5))[2]["u_alpha"], (59.570843, 4.409105), atol=1e-6)
    np.testing.assert_allclose(update("sdf", (104, 103.5))[2]["u_alpha"], (0.562926, 2.802874), atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_the_weighted_solution_equals_its_information_form(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((2, 2))
    prior, alpha, beta = A @ A.T + 0.1 * np.eye(2), rng.uniform(0.01, 1, 2), rng.uniform(0.01, 1)
    x, y = rng.standard_normal(2), rng.standard_normal(2)
    sensors = Sensors((y - H @ x)[:, None], np.diag(R)[:, None], prior[:1, 0])
    for factors in ([beta], [beta, rng.uniform(0.01, 1)]):
        mean, cov = weighted_solution(
            x[:, None], prior[..., None], H[0], sensors, alpha[:, None], np.array(factors)[:, None]
        )
        expected, expected_cov = oracle.solution(x, prior, H, R, y, alpha, factors)
        np.testing.assert_allclose(mean[:, 0], expected, rtol=1e-9)
        np.testing.assert_allclose(cov[..., 0], expected_cov, rtol=1e-9)


TWINS = {
    "sdf": oracle.sdf, "raf": oracle.raf, "daf": oracle.daf,
    "raf_trace": lambda *a: oracle.raf(*a, norm="trace"), "daf_joint": lambda *a: oracle.daf(*a, order="separate"),
}  # fmt: skip


@pytest.mark.parametrize("name", TWINS)
def test_trajectories_equal_those_of_the_textbook_filter(name):
    rng = np.random.default_rng(7)
    y = 20.0 * np.arange(1, 61)[:, None, None] + rng.standard_normal((60, 2, 4)) * np.array([5.0, 1.0])[:, None]
    y[[9, 39], 0] += 300
    y[30:, :, 1] += 15  # what the model does not know
    result = filt(name).run(CAR, y, [0, 20], np.diag([25.0, 1.0]), Q=Q, R=R)
    for i in range(4):
        xs, Ps = oracle.run(TWINS[name], F, H, Q, R, [0, 20], np.diag([25.0, 1.0]), y[..., i])
        np.testing.assert_allclose(result.mean[..., i], xs, rtol=1e-7)
        np.testing.assert_allclose(result.cov[..., i], Ps, rtol=1e-5, atol=1e-8)


def test_the_robust_positions_of_raf_are_the_same_found_for_all_epochs_or_for_each():
    """One missing component makes each epoch find its own."""
    rng = np.random.default_rng(8)
    y = 20.0 * np.arange(1, 41)[:, None, None] + rng.standard_normal((40, 2, 3)) * np.array([5.0, 1.0])[:, None]
    y[7, 0] += 300
    varying = np.broadcast_to(R[..., None], (40, 2, 2, 3)) * rng.uniform(0.5, 2.0, (40, 1, 1, 3))
    for told in (R, varying):
        ahead = filt("raf").run(CAR, y, [0, 20], P, Q=Q, R=told)
        broken = y.copy()
        broken[-1, 1] = np.nan
        each = filt("raf").run(CAR, broken, [0, 20], P, Q=Q, R=told)
        np.testing.assert_allclose(ahead.mean[:-1], each.mean[:-1], rtol=1e-9)
        np.testing.assert_allclose(ahead.cov[:-1], each.cov[:-1], rtol=1e-8)


@pytest.mark.parametrize(("name", "params", "twin"), [
    ("daf", {"u_cov": "inflated"}, lambda *a: oracle.daf(*a, u_cov="inflated")),
    ("sdf", {"mean": "robust"}, lambda *a: oracle.sdf(*a, mean="robust")),
])  # fmt: skip
def test_the_variants_equal_their_twins(name, params, twin):
    y = np.array([116.0, 101.5])
    alpha, beta, _ = twin(X, P, H, R, y)
    mean, cov, _ = update(name, y, **params)
    expected, expected_cov = oracle.solution(X, P, H, R, y, alpha, beta)
    assert 1e-5 < beta < 1 and alpha.min() < 1
    np.testing.assert_allclose(mean, expected, rtol=1e-10)
    np.testing.assert_allclose(cov, expected_cov, rtol=1e-9)


def test_sdf_may_weaken_the_measured_state_alone():
    _, cov, seen = update("sdf", (104, 103.5), states="measured")
    assert seen["beta"][1] == 1 > seen["beta"][0]
    expected = oracle.solution(X, P, H, R, np.array([104, 103.5]), seen["alpha"], seen["beta"])[1]
    np.testing.assert_allclose(cov, expected, rtol=1e-8)


@pytest.mark.parametrize("name", FACTORED)
def test_without_thresholds_every_filter_is_the_kalman_filter(name):
    y = np.random.default_rng(3).standard_normal((20, 2, 3)) * 50
    plain = build("skf").run(CAR, y, X, P, Q=Q, R=R)
    result = filt(name, lambda_alpha=1e9, lambda_beta=1e9).run(CAR, y, X, P, Q=Q, R=R)
    np.testing.assert_allclose(result.mean, plain.mean, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(result.cov, np.broadcast_to(plain.cov, result.cov.shape), rtol=1e-9)


def test_a_common_factor_of_all_leaves_the_mean_and_divides_the_covariance():
    sensors = Sensors(np.array([[3.0], [1.0]]), np.diag(R)[:, None], P[:1, 0])
    one = weighted_solution(X[:, None], P[..., None], H[0], sensors, np.ones((2, 1)), np.ones((1, 1)))
    c = weighted_solution(X[:, None], P[..., None], H[0], sensors, np.full((2, 1), 0.3), np.full((1, 1), 0.3))
    np.testing.assert_allclose(c[0], one[0], rtol=1e-14)
    np.testing.assert_allclose(c[1], one[1] / 0.3, rtol=1e-13)


def test_both_components_of_the_state_residual_standardise_to_one_u_whatever_beta_is():
    y = np.array([140.0, 103.0])
    for alpha in ([1, 1], [0.2, 0.9], [1e-6, 0.03]):
        for beta in (1.0, 0.01):
            inflated = R @ np.linalg.inv(np.diag(alpha))
            K = P / beta @ H.T @ np.linalg.inv(H @ P @ H.T / beta + inflated)
            S = H @ P @ H.T + R
            u = K @ (y - H @ X) / np.sqrt(np.diag(K @ S @ K.T))
            assert u[0] == pytest.approx(u[1], rel=1e-10)
            if beta == 1:
                first = u[0]
            assert u[0] == pytest.approx(first, rel=1e-10)


def test_for_one_fused_measurement_beta_over_alpha_is_exp_of_4_minus_2u():
    _, _, seen = update("daf_fused", (104, 103.5), floor=1e-300)
    u = seen["u_beta"][0]
    assert seen["u_alpha"][0] == pytest.approx(u, rel=1e-12)
    assert u > 2.5
    assert seen["beta"][0] / seen["alpha"][0] == pytest.approx(np.exp(4 - 2 * u), rel=1e-12)


def test_a_gross_error_on_one_sensor_moves_the_residual_of_the_other():
    c = 0.5 / (1 + 0.5 * (1 / 25 + 1))
    sd = np.sqrt(1 - c)
    clean, dirty = (update("daf", y)[2]["u_alpha"][1] * sd for y in ((100, 100), (400, 100)))
    assert dirty - clean == pytest.approx(300 * c / 25, rel=1e-12)


def test_sensors_one_after_the_other_are_the_stacked_ones_while_all_factors_are_one():
    stacked = update("skf", (103, 101))
    one = build_model({"kind": "odometers", "sensors": ["A"]})
    x, cov = X[:, None], P[..., None]
    for y, r in ((103.0, 25.0), (101.0, 1.0)):
        x, cov, _ = build("skf").correct(one, x, cov, np.array([[y]]), 1, np.array([[[r]]]))
    np.testing.assert_allclose(x[:, 0], stacked[0], rtol=1e-12)
    np.testing.assert_allclose(cov[..., 0], stacked[1], rtol=1e-12)


def test_the_standard_filter_reaches_the_steady_state_of_the_note():
    result = build("skf").run(
        CAR, np.zeros((1500, 2, 1)), [0, 20], np.diag([25.0, 1.0]), Q=Q, R=R, keep=("cov", "prior_cov")
    )
    np.testing.assert_allclose(
        result.extras["prior_cov"][-1, ..., 0], [[0.547458874, 0.1228412527], [0.1228412527, 0.04956637018]], rtol=1e-8
    )
    Pm, Pp = result.extras["prior_cov"][-1, ..., 0], result.cov[-1, ..., 0]
    np.testing.assert_allclose(Pp, [[0.3488427389, 0.07827488248], [0.07827488248, 0.03956637018]], rtol=1e-8)
    K = Pm @ H.T @ np.linalg.inv(H @ Pm @ H.T + R)
    np.testing.assert_allclose(K, [[0.01395370955, 0.3488427389], [0.003130995299, 0.07827488248]], rtol=1e-8)
    G, E = (np.eye(2) - K @ H) @ F, np.zeros((2, 2))
    for _ in range(2000):
        E = G @ E @ G.T + K @ R @ K.T
    assert np.sqrt(E[0, 0]) == pytest.approx(0.5292476, abs=1e-7)
    assert np.sqrt(Pp[0, 0]) == pytest.approx(0.5906291, abs=1e-7)


def test_a_sensor_that_is_missing_is_left_out():
    y = np.array([[[np.nan], [103.5]]])
    result = build("daf").run(CAR, y, X, P, Q=Q, R=R)
    one = build_model({"kind": "odometers", "sensors": ["B"]})
    alone = build("daf").run(one, y[:, 1:], X, P, Q=Q, R=R[1:, 1:])
    np.testing.assert_allclose(result.mean, alone.mean, rtol=1e-13)


def test_dependent_sensors_and_sensors_of_different_quantities_are_refused():
    with pytest.raises(SpecError, match="independent sensors"):
        build("daf").run(CAR, np.zeros((2, 2)), X, P, Q=Q, R=[[2, 1], [1, 2]])
    with pytest.raises(SpecError, match="same quantity"):
        build("raf").check(linear_problem().model)


@pytest.mark.parametrize(
    "params", [{"lambda_alpha": 0}, {"lambda_beta": -1.0}, {"floor": 0.0}, {"floor": 1.5}, {"factor": "huber"}]
)
def test_senseless_parameters_are_refused(params):
    with pytest.raises(SpecError):
        build("daf", **params)


@pytest.mark.parametrize("name", TWINS)
def test_no_number_depends_on_the_width_of_the_batch(name):
    rng = np.random.default_rng(11)
    y = 20.0 * np.arange(1, 41)[:, None, None] + rng.standard_normal((40, 2, 256)) * np.array([9.0, 3.0])[:, None]
    whole, half = (filt(name).run(CAR, each, [0, 20], np.diag([25.0, 1.0]), Q=Q, R=R) for each in (y, y[..., 128:]))
    np.testing.assert_array_equal(whole.mean[..., 128:], half.mean)
