import numpy as np
import pytest
from filterpy.kalman import JulierSigmaPoints, MerweScaledSigmaPoints, UnscentedKalmanFilter

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.filters.sigma import Cubature, DividedDifference, Unscented, square_root
from rkfbench.models.altitude import Altitude
from rkfbench.models.range_bearing import RangeBearing
from tests.oracles import nonlinear as oracle
from tests.oracles.linear import linear_filter
from tests.problems import Bent, linear_problem, spd

RULES = {
    "unscented": lambda x, P: oracle.unscented_points(x, P, 1.0, 0.0, 3 - len(x)),
    "cubature": oracle.cubature_points,
}
SPECS = [
    ({"unscented": {}}, RULES["unscented"]),
    ({"unscented": {"alpha": 0.5, "beta": 2.0, "kappa": 1}}, lambda x, P: oracle.unscented_points(x, P, 0.5, 2.0, 1)),
    ("cubature", RULES["cubature"]),
]
MODEL = Bent()
PRIOR = np.array([1.0, -0.5, 0.3]), spd(3, 7, 0.4), spd(3, 8, 0.2), spd(2, 9, 0.3)


def told(problem=PRIOR):
    x0, P0, Q, R = problem
    return {"x0": x0, "P0": P0, "Q": Q, "R": R}


@pytest.mark.parametrize("redraw", [True, False])
@pytest.mark.parametrize(("spec", "draw"), SPECS)
def test_one_step_is_the_textbook_with_weights(spec, draw, redraw):
    x0, P0, Q, R = PRIOR
    y = np.array([3.0, 2.0])
    name, params = next(iter(spec.items())) if isinstance(spec, dict) else (spec, {})
    filt = build({"moments": {name: {**params, "redraw": redraw}}})
    est = filt.run(MODEL, y[None], **told(), keep=("cov", "prior_mean", "prior_cov"))
    xp, Pp, x, P = oracle.sigma_step(
        x0, P0, y, lambda s: MODEL.f(s, 1), lambda s: MODEL.h(s, 1), Q, R, draw, redraw, MODEL.angles
    )
    for ours, naive in ((est.extras["prior_mean"], xp), (est.extras["prior_cov"], Pp), (est.mean, x), (est.cov, P)):
        np.testing.assert_allclose(ours[0, ..., 0], naive, atol=1e-12)


def test_reused_points_differ_from_redrawn_ones():
    y = np.array([[3.0, 2.0]])
    one, other = (build("ukf", redraw=redraw).run(MODEL, y, **told()) for redraw in (True, False))
    assert np.abs(one.mean - other.mean).max() > 1e-4


def test_divided_differences_are_the_textbook_formulae():
    x0, P0, Q, R = PRIOR
    y = np.array([3.0, 2.0])
    est = build("ddf", h2=2.5).run(MODEL, y[None], **told(), keep=("cov", "prior_mean", "prior_cov"))
    x, P, _ = oracle.divided_difference(x0, P0, lambda s: MODEL.f(s, 1), 2.5)
    P = P + Q
    np.testing.assert_allclose(est.extras["prior_cov"][0, ..., 0], P, atol=1e-12)
    offset = lambda s: oracle.residual(MODEL.h(s, 1), MODEL.h(x, 1), MODEL.angles)  # noqa: E731
    z, S, C = oracle.divided_difference(x, P, offset, 2.5)
    K = C @ np.linalg.inv(S + R)
    np.testing.assert_allclose(
        est.mean[0, :, 0], x + K @ oracle.residual(y, MODEL.h(x, 1) + z, MODEL.angles), atol=1e-12
    )
    np.testing.assert_allclose(est.cov[0, ..., 0], P - K @ (S + R) @ K.T, atol=1e-12)


@pytest.mark.parametrize(
    ("params", "points"),
    [
        ({}, JulierSigmaPoints(3, 0.0)),
        ({"alpha": 0.6, "beta": 2.0, "kappa": 1}, MerweScaledSigmaPoints(3, 0.6, 2.0, 1)),
    ],
)
def test_ukf_is_filterpys_over_a_trajectory(params, points):
    model, (x0, P0, Q, R) = Bent(angle="atan2_raw"), PRIOR
    y = model_measurements(model, 30)
    est = build("ukf", **params).run(model, y, **told())
    theirs = UnscentedKalmanFilter(3, 2, 1.0, lambda x: model.h(x, 1), lambda x, dt: model.f(x, 1), points)
    theirs.x, theirs.P, theirs.Q, theirs.R = x0.copy(), P0.copy(), Q, R
    for k, yk in enumerate(y):
        theirs.predict()
        theirs.sigmas_f = points.sigma_points(theirs.x, theirs.P)
        theirs.update(yk)
        np.testing.assert_allclose(est.mean[k, :, 0], theirs.x, atol=1e-10)
        np.testing.assert_allclose(est.cov[k, :, :, 0], theirs.P, atol=1e-10)


def model_measurements(model, steps):
    rng = np.random.default_rng(4)
    x, ys = PRIOR[0], []
    for k in range(steps):
        x = model.f(x, k + 1) + 0.3 * rng.standard_normal(3)
        ys.append(model.h(x, k + 1) + 0.4 * rng.standard_normal(2))
    return np.array(ys)


@pytest.mark.parametrize("redraw", [True, False])
@pytest.mark.parametrize("name", ["unscented", "cubature", "divided_difference"])
def test_every_rule_is_the_kalman_filter_on_a_linear_model(name, redraw):
    p = linear_problem()
    F, H, _ = p.model.matrices
    est = build({"moments": {name: {"redraw": redraw}}}).run(p.model, p.y, **p.told)
    if not redraw:  # the reused points know nothing of Q: another filter, equal where there is none
        p = linear_problem()
        est = build({"moments": {name: {"redraw": False}}}).run(p.model, p.y[:1], **{**p.told, "Q": np.zeros((4, 4))})
    for i in range(est.mean.shape[2]):
        Q = p.Q if redraw else 0 * p.Q
        x, P, _ = linear_filter(F, H, Q, p.R, p.x0, p.P0, p.y[: len(est.mean), :, i])
        np.testing.assert_allclose(est.mean[..., i], x, atol=1e-9)
        np.testing.assert_allclose(est.cov[..., i], P, atol=1e-9)


def test_cubature_is_unscented_with_alpha_1_beta_0_kappa_0():
    y = model_measurements(MODEL, 20)
    one, other = build("ckf"), build("ukf", kappa=0)
    a, b = (each.run(MODEL, y, **told(), keep=("cov", "prior_cov")) for each in (one, other))
    for left, right in ((a.mean, b.mean), (a.cov, b.cov), (a.extras["prior_cov"], b.extras["prior_cov"])):
        np.testing.assert_allclose(left, right, atol=1e-12)


@pytest.mark.parametrize("name", ["ukf", "ckf"])
def test_the_prediction_of_a_linear_motion_is_kalmans(name):
    model, P, Q = Altitude(), spd(6, 1), spd(6, 2)
    x = np.array([2.0, 2, 50, 6, 6, 0])
    est = build(name).run(model, np.zeros((1, 4)), x, P, Q=Q, R=np.eye(4), keep=("prior_mean", "prior_cov"))
    F = model.F(x, 1)
    np.testing.assert_allclose(est.extras["prior_mean"][0, :, 0], F @ x, rtol=1e-12)
    np.testing.assert_allclose(est.extras["prior_cov"][0, :, :, 0], F @ P @ F.T + Q, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("name", ["ukf", "ckf", "ddf"])
def test_a_full_turn_of_the_measured_bearing_changes_nothing(name):
    model, x0, P0 = RangeBearing(), np.array([-20.0, 1.0]), 30 * spd(2, 3)
    y = np.array([[20.0, 3.0]])
    R = np.diag([1.0, 0.01])
    turned = y + np.array([0, 2 * np.pi])
    one, other = (build(name).run(model, each, x0, P0, Q=np.zeros((2, 2)), R=R) for each in (y, turned))
    np.testing.assert_allclose(one.mean, other.mean, atol=1e-12)


@pytest.mark.parametrize("name", ["ekf", "ukf", "ckf", "ddf", "pekf"])
def test_turning_the_scene_by_pi_turns_the_result_across_the_cut(name):
    model, P0, R = RangeBearing(), np.diag([30.0, 90.0]), np.diag([1.0, 0.01])
    x0, y = np.array([20.0, 1.0]), np.array([[21.0, 0.1]])
    one = build(name).run(model, y, x0, P0, Q=np.zeros((2, 2)), R=R)
    other = build(name).run(model, y + np.array([0, np.pi]), -x0, P0, Q=np.zeros((2, 2)), R=R)
    np.testing.assert_allclose(other.mean, -one.mean, atol=1e-12)
    np.testing.assert_allclose(other.cov, one.cov, atol=1e-12)


def test_variances_of_many_magnitudes_keep_their_digits():
    correlation = spd(4, 6)
    D = np.array([1e3, 1.0, 1e-2, 1e-5])
    scaled = square_root(correlation[..., None])[..., 0]
    straight = square_root((D[:, None] * correlation * D)[..., None])[..., 0]
    np.testing.assert_allclose(straight, D[:, None] * scaled, rtol=1e-13)


def test_an_indefinite_covariance_has_the_root_of_its_positive_part_and_disturbs_no_other_run():
    good = spd(3, 5)
    P = np.stack([good, np.diag([4.0, -1.0, 9.0]), np.full((3, 3), np.nan)], axis=-1)
    L = square_root(P)
    np.testing.assert_array_equal(L[..., 0], square_root(good[..., None])[..., 0])
    np.testing.assert_allclose(L[..., 1] @ L[..., 1].T, np.diag([4.0, 0.0, 9.0]), atol=1e-12)
    assert np.isnan(L[..., 2]).any()


def test_weights_that_are_undefined_are_refused():
    filt = build("ukf", kappa=-3)
    with pytest.raises(SpecError, match="n \\+ kappa must be positive"):
        filt.check(MODEL)
    with pytest.raises(SpecError, match="greater than 0"):
        build("ukf", alpha=0.0)


@pytest.mark.parametrize("rule", [Unscented(), Cubature(), DividedDifference()])
def test_the_slope_of_a_linear_function_is_its_matrix(rule):
    p = linear_problem()
    slope = rule.slope(p.model, p.x0[:, None], p.P0[..., None], 1)
    np.testing.assert_allclose(slope[..., 0], p.model.matrices[1], atol=1e-12)


@pytest.mark.parametrize("rule", [Unscented(), Unscented(alpha=0.3, beta=2.0), Cubature(), DividedDifference()])
def test_the_prediction_of_an_affine_motion_takes_no_points_and_is_theirs(rule, monkeypatch):
    model, rng = Altitude(dt=0.7), np.random.default_rng(4)
    x, P = rng.normal(0, 50, (6, 2)), np.stack([spd(6, 1, 3.0), spd(6, 2, 3.0)], axis=-1)
    short = rule.propagate(model, x, P, 1)
    monkeypatch.setattr(Altitude, "affine", False)
    for ours, points in zip(short, rule.propagate(model, x, P, 1), strict=True):
        np.testing.assert_allclose(ours, points, rtol=1e-12, atol=1e-11)


def test_the_prediction_of_an_affine_motion_needs_no_positive_covariance():
    """It is F P F' of any P; points would be those of its positive part."""
    model, P = Altitude(dt=0.7), spd(6, 2, 3.0) - 4.0 * np.eye(6)
    assert np.linalg.eigvalsh(P)[0] < 0
    F = model.F(np.zeros((6, 1)), 1)
    _, moved = Cubature().propagate(model, np.zeros((6, 1)), P[..., None], 1)
    np.testing.assert_allclose(moved[..., 0], F @ P @ F.T, atol=1e-12)
