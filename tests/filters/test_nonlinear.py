import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import build
from rkfbench.models.base import Smooth
from rkfbench.models.range_bearing import RangeBearing
from rkfbench.models.ungm import UNGM
from rkfbench.streams import Streams
from tests.oracles import nonlinear as oracle
from tests.problems import Bent, spd

MODEL = Bent()
TOLD = {"x0": np.array([1.0, -0.5, 0.3]), "P0": spd(3, 7, 0.4), "Q": spd(3, 8, 0.2), "R": spd(2, 9, 0.3)}
VARIANCES = {"R1": [0.1542125687, 25.0, 25.0, 25.0]}


def measured(steps=30, runs=3):
    rng = np.random.default_rng(2)
    return rng.normal([[2.0], [0.2]], 0.6, (steps, 2, runs))


def test_ekf_is_filterpys_over_a_trajectory():
    y = measured()
    est = build("ekf").run(MODEL, y, **TOLD)
    for i in range(y.shape[2]):
        theirs = ExtendedKalmanFilter(3, 2)
        theirs.x, theirs.P, theirs.Q, theirs.R = TOLD["x0"].copy(), TOLD["P0"].copy(), TOLD["Q"], TOLD["R"]
        for k, yk in enumerate(y[..., i], 1):
            theirs.F = MODEL.F(theirs.x, k)
            theirs.P = theirs.F @ theirs.P @ theirs.F.T + theirs.Q
            theirs.x = MODEL.f(theirs.x, k)
            theirs.update(
                yk, lambda x: MODEL.H(x, 1), lambda x: MODEL.h(x, 1), residual=lambda a, b: MODEL.residual(a, b)
            )
            np.testing.assert_allclose(est.mean[k - 1, :, i], theirs.x, atol=1e-10)
            np.testing.assert_allclose(est.cov[k - 1, :, :, i], theirs.P, atol=1e-10)


@pytest.mark.parametrize("where", ["posterior", "predicted"])
def test_the_jacobian_of_the_motion_is_taken_where_it_is_said(where):
    est = build("ekf", linearise_at=where).run(MODEL, measured(1), **TOLD, keep=("prior_cov",))
    reached = MODEL.f(TOLD["x0"], 1)
    F = MODEL.F(TOLD["x0"] if where == "posterior" else reached, 1)
    np.testing.assert_allclose(est.extras["prior_cov"][0, ..., 0], F @ TOLD["P0"] @ F.T + TOLD["Q"], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "params", "scheme"),
    [
        ("ekf", {}, lambda *a: oracle.ekf(*a, MODEL.angles)),
        ("iekf", {"iterations": 4}, lambda *a: oracle.iterated(*a, 4, MODEL.angles)),
        ("pekf", {"dl": 0.2}, lambda *a: oracle.progressive(*a, 0.2, MODEL.angles)),
    ],
)
def test_named_filters_are_their_textbook_loops(name, params, scheme):
    y = measured(15, 1)
    est = build(name, **params).run(MODEL, y, **TOLD)
    x, P = TOLD["x0"], TOLD["P0"]
    for k, yk in enumerate(y[..., 0], 1):
        F = MODEL.F(x, k)
        x, P = MODEL.f(x, k), F @ P @ F.T + TOLD["Q"]
        x, P = scheme(x, P, yk, lambda s: MODEL.h(s, 1), lambda s: MODEL.H(s, 1), TOLD["R"])
        np.testing.assert_allclose(est.mean[k - 1, :, 0], x, atol=1e-9)
        np.testing.assert_allclose(est.cov[k - 1, ..., 0], P, atol=1e-9)


@pytest.mark.parametrize("name", ["ukf", "ckf", "ddf"])
@pytest.mark.parametrize("redraw", [True, False])
def test_a_missing_component_is_left_out_of_the_update(name, redraw):
    y = measured(4, 2)
    y[1, 1, 0] = y[2, :, 1] = np.nan
    est = build(name, redraw=redraw).run(MODEL, y, **TOLD)
    assert np.isfinite(est.mean).all()
    full = build(name, redraw=redraw).run(MODEL, measured(4, 2), **TOLD)
    np.testing.assert_array_equal(est.mean[0], full.mean[0])
    assert np.abs(est.mean[1, :, 0] - full.mean[1, :, 0]).max() > 1e-3
    np.testing.assert_allclose(est.mean[1, :, 1], full.mean[1, :, 1], atol=1e-13)


def test_one_dead_run_leaves_the_others_byte_for_byte():
    y = measured(10, 128)
    hurt = y.copy()
    hurt[3, 0, 7] = np.inf
    others = np.arange(128) != 7
    for name in ("ekf", "ukf", "ckf", "ddf", "iekf", "pekf"):
        one, other = build(name).run(MODEL, y, **TOLD), build(name).run(MODEL, hurt, **TOLD)
        assert np.array_equal(one.mean[..., others], other.mean[..., others])
        assert list(np.flatnonzero(other.failed)) == [7]


def test_no_number_depends_on_the_width_of_the_batch():
    y = measured(6, 512)
    for name in ("ekf", "ukf", "ckf", "ddf", "iekf", "pekf"):
        whole, part = (build(name).run(MODEL, y[..., :runs], **TOLD) for runs in (512, 128))
        assert np.array_equal(whole.mean[..., :128], part.mean) and np.array_equal(whole.cov[..., :128], part.cov)


def test_a_model_without_jacobians_serves_sigma_points_only():
    class Opaque(Smooth):
        states, measurements, linear = ("a",), ("y",), False

        def f(self, x, k):
            return 0.5 * x

        def h(self, x, k):
            return x**3

    with pytest.raises(SpecError, match="Jacobians"):
        build("ekf").check(Opaque())
    est = build("ukf").run(Opaque(), np.ones((3, 1)), np.ones(1), np.eye(1), Q=np.eye(1), R=np.eye(1))
    assert np.isfinite(est.mean).all()


def test_linear_moments_refuse_a_nonlinear_model():
    with pytest.raises(SpecError, match="linear model"):
        build("kf").check(UNGM())


def test_the_growth_model_learns_nothing_at_0():
    one = np.ones((1, 1, 1))
    for name in ("ekf", "pekf", "iekf"):
        after = build(name).correct(UNGM(), np.zeros((1, 1)), one, np.array([[5.0]]), 1, 0.01 * one)
        assert after.x[0, 0] == 0 and after.P[0, 0, 0] == 1


# --- the estimates of the note: the data and the filters are wired as there -----------------------------------------


def run(spec, filters, runs):
    spec = {**spec, "filters": [{"label": name, "use": name} for name in filters], "metrics": ["rmse"]}
    experiment = Experiment.of(spec)
    world = experiment.simulate(Streams(11, 0, runs // 128))
    for name, (filt, told) in experiment.filters.items():
        est = filt.run(experiment.assumed_model, world.y, world.x0, told.P0, Q=told.Q, R=told.R, keep=())
        yield name, ((est.mean - world.x) ** 2).sum(1)


def near(ours, se, printed, printed_se):
    assert abs(ours - printed) < 4 * np.hypot(se, printed_se)


def test_range_bearing_meets_the_known_errors_at_k_50():
    spec = {
        "steps": 50,
        "model": {"kind": "range_bearing"},
        "start": {"truth": [100, 100]},
        "measurement_noise": {"kind": "gaussian", "cov": [2.5e-5, 6e-3]},
        "assumed": {"mean": [20, 80], "cov": 100},
    }
    known = {"ekf": (60.43, 0.02), "ckf": (49.19, 0.01), "pekf": (7.21, 0.02)}
    for name, squares in run(spec, known, 2048):
        rmse = np.sqrt(squares[49].mean())
        near(rmse, squares[49].std() / (2 * rmse * np.sqrt(2048)), *known[name])


def test_the_growth_model_meets_the_known_errors():
    spec = {
        "steps": 150,
        "model": {"kind": "ungm"},
        "start": {"truth": [0.1]},
        "process_noise": {"kind": "gaussian", "cov": 10},
        "measurement_noise": {"kind": "gaussian", "sd": 0.1},
        "assumed": {"mean": [0.1], "cov": 0.1},
    }
    known = {"ekf": (40.82, 0.08), "pekf": (13.56, 0.01)}
    for name, squares in run(spec, known, 4096):
        each = np.sqrt(squares.mean(0))
        near(each.mean(), each.std() / 64, *known[name])


def test_altitude_tracking_meets_the_known_errors():
    Q = 5 * np.kron([[1 / 3, 1 / 2], [1 / 2, 1]], np.eye(3))
    spec = {
        "steps": 100,
        "model": {"kind": "altitude"},
        "start": {"truth": [0, 0, 50, 5, 5, 0.1]},
        "process_noise": {"kind": "gaussian", "cov": Q.tolist()},
        "measurement_noise": {"kind": "gaussian", "cov": VARIANCES["R1"]},
        "assumed": {"mean": [2, 2, 50, 6, 6, 0], "cov": 1},
    }
    known = {"ekf": (125.6, 0.7), "pekf": (102.8, 0.5)}
    for name, squares in run(spec, known, 512):
        each = np.sqrt(squares.mean(0))
        near(each.mean(), each.std() / np.sqrt(512), *known[name])


# --- marks --------------------------------------------------------------------------------------------------------


def test_bayes_on_a_grid_is_bayes_on_a_plane():
    x0, P0, R = np.array([20.0, 80.0]), 100 * np.eye(2), np.diag([1e-4, 6e-3])
    y = np.array([[95.0, 1.1], [95.01, 1.3], [94.99, 1.15]])
    est = build("bayes").run(RangeBearing(), y, x0, P0, Q=np.zeros((2, 2)), R=R)
    r = np.linspace(94.96, 95.04, 161)[:, None]
    angle = np.linspace(0.2, 2.2, 4001)[None]
    u = np.stack([r * np.cos(angle), r * np.sin(angle)])
    d = u - x0[:, None, None]
    log = -0.5 * (d * d).sum(0) / 100 + np.log(r)  # polar coordinates have the volume r
    for rk, bk in y:
        log = log - 0.5 * (rk - r) ** 2 / 1e-4 - 0.5 * (bk - angle) ** 2 / 6e-3
    w = np.exp(log - log.max())
    w /= w.sum()
    mean = (u * w).sum((1, 2))
    np.testing.assert_allclose(est.mean[2, :, 0], mean, atol=2e-3)
    d = u - mean[:, None, None]
    np.testing.assert_allclose(est.cov[2, :, :, 0], np.einsum("iab,jab,ab->ij", d, d, w), atol=0.05)


def test_bayes_knows_a_bearing_by_atan_up_to_half_a_turn():
    told = {"x0": np.array([-60.0, 70.0]), "P0": 100 * np.eye(2), "Q": np.zeros((2, 2)), "R": np.diag([1e-4, 6e-3])}
    y = np.array([[95.0, 2.3], [95.01, 2.2], [94.99, 2.25]])
    whole = build("bayes").run(RangeBearing(), y, **told)
    half = build("bayes").run(RangeBearing(angle="atan_wrap"), y - [0, np.pi], **told)
    np.testing.assert_allclose(half.mean, whole.mean, atol=1e-6)
    assert np.abs(build("bayes").run(RangeBearing(), y - [0, np.pi], **told).mean - whole.mean).max() > 10


def test_zero_is_zero_and_says_so():
    est = build("zero").run(MODEL, measured(3), **TOLD)
    assert not est.mean.any() and not est.failed.any()
    with pytest.raises(SpecError, match="range_bearing"):
        build("bayes").check(MODEL)
