import numpy as np
import pytest
from scipy.special import lambertw

from rkfbench.errors import SpecError
from rkfbench.filters import SCHEMES, build
from rkfbench.models.base import Linear
from tests.oracles import nonlinear as oracle
from tests.oracles.linear import linear_filter
from tests.problems import Bent, linear_problem, spd

MODEL = Bent()
X, P0, R = np.array([1.0, -0.5, 0.3]), spd(3, 7, 0.4), spd(2, 9, 0.3)
Y = np.array([3.0, 2.0])


def update(scheme, moments="taylor", weight="none", x=X, P=P0, y=Y, cov=R, model=MODEL, **params):
    filt = build({"moments": moments, "weight": weight, "update": {scheme: params} if params else scheme})
    return filt.correct(model, x[:, None], P[..., None], np.asarray(y, float)[:, None], 1, cov[..., None])


def h(x):
    return MODEL.h(x, 1)


def jac(x):
    return MODEL.H(x, 1)


class Scalar(Linear):
    states, measurements = ("x",), ("y",)
    matrices = np.eye(1), np.eye(1), None


@pytest.mark.parametrize("moments", ["taylor", "unscented", "cubature", "divided_difference"])
@pytest.mark.parametrize("scheme", ["progressive", "tempered", "inflated"])
def test_with_dl_1_a_scheme_is_one_update_bit_for_bit(scheme, moments):
    one, other = update(scheme, moments, dl=1.0), update("once", moments)
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.P, other.P)


@pytest.mark.parametrize("dl", [0.5, 0.1, 0.02])
@pytest.mark.parametrize("scheme", ["progressive", "tempered", "inflated"])
def test_a_scheme_is_its_textbook_loop(scheme, dl):
    x, P = getattr(oracle, scheme)(X, P0, Y, h, jac, R, dl, MODEL.angles)
    after = update(scheme, dl=dl)
    np.testing.assert_allclose(after.x[:, 0], x, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(after.P[..., 0], P, rtol=1e-10, atol=1e-11)


def test_the_iterated_update_is_the_textbook_loop():
    x, P = oracle.iterated(X, P0, Y, h, jac, R, 10, MODEL.angles)
    after = update("iterated")
    np.testing.assert_allclose(after.x[:, 0], x, atol=1e-11)
    np.testing.assert_allclose(after.P[..., 0], P, atol=1e-11)


def test_one_progressive_sub_step_is_a_kalman_update_with_inflated_noise():
    dl = 0.1
    H, nu = jac(X), oracle.residual(Y, h(X), MODEL.angles)
    S = H @ P0 @ H.T + R
    K = P0 @ H.T @ np.linalg.inv(S)
    x, P = X + dl * K @ nu, P0 - dl * K @ H @ P0
    Rt = R / dl + (1 / dl - 1) * H @ P0 @ H.T
    after = update("once", cov=Rt)
    np.testing.assert_allclose(after.x[:, 0], x, rtol=1e-12)
    np.testing.assert_allclose(after.P[..., 0], P, rtol=1e-12, atol=1e-13)
    Kt = P0 @ H.T @ np.linalg.inv(H @ P0 @ H.T + Rt)
    I_KH = np.eye(3) - Kt @ H
    np.testing.assert_allclose(I_KH @ P0 @ I_KH.T + Kt @ Rt @ Kt.T, P, rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize(
    ("rho", "dl", "p"),
    [
        *((1, 1, 0.5), (1, 0.5, 0.589286), (1, 0.1, 0.633237)),
        *((10, 1, 0.090909), (10, 0.5, 0.314981), (10, 0.1, 0.404457)),
        *((1e9, 0.5, 0.25), (1e9, 0.1, 0.348678)),
    ],
)
def test_the_scalar_table_of_what_is_left_of_the_prior(rho, dl, p):
    x, P, y, cov = np.array([1.0]), np.array([[2.0]]), np.array([4.0]), np.array([[2.0 / rho]])
    after = update("progressive", x=x, P=P, y=y, cov=cov, model=Scalar(), dl=dl)
    np.testing.assert_allclose(after.P[0, 0, 0] / 2, p, atol=6e-7)
    np.testing.assert_allclose(after.x[0, 0], 1 + (1 - after.P[0, 0, 0] / 2) * 3, rtol=1e-12)
    bayes = update("tempered", x=x, P=P, y=y, cov=cov, model=Scalar(), dl=dl)
    np.testing.assert_allclose(bayes.P[0, 0, 0] / 2, 1 / (1 + rho), rtol=1e-6)
    if rho > 1e6:
        np.testing.assert_allclose(p, (1 - dl) ** (1 / dl), atol=6e-7)
        same = update("inflated", x=x, P=P, y=y, cov=cov, model=Scalar(), dl=dl)
        np.testing.assert_allclose(same.P, after.P, rtol=1e-6)
        np.testing.assert_allclose(same.x, after.x, rtol=1e-6)


@pytest.mark.parametrize(("rho", "p"), [(1, 0.642201), (10, 0.421903), (1e9, 0.367879)])
def test_the_scalar_limit_of_small_steps(rho, p):
    exact = 1 / (rho * lambertw(np.exp(1 + 1 / rho) / rho).real)
    np.testing.assert_allclose(exact, p, atol=6e-7)
    one = np.ones((1, 1))
    after = update("progressive", x=np.zeros(1), P=one, y=np.ones(1), cov=one / rho, model=Scalar(), dl=1e-3)
    np.testing.assert_allclose(after.P[0, 0, 0], p, atol=3e-4)


def test_the_table_holds_for_every_mode_of_a_vector_measurement():
    p = linear_problem()
    _, H, _ = p.model.matrices
    after = update("progressive", x=p.x0, P=p.P0, y=p.y[0, :, 0], cov=p.R, model=p.model, dl=0.1)
    L = np.linalg.inv(np.linalg.cholesky(p.R)) @ H
    before_modes, modes = np.linalg.eigh(L @ p.P0 @ L.T)
    after_modes = np.diag(modes.T @ L @ after.P[..., 0] @ L.T @ modes)
    for rho, left in zip(before_modes, after_modes, strict=True):
        q = 1.0
        for _ in range(10):
            q *= 1 - 0.1 * q * rho / (q * rho + 1)
        np.testing.assert_allclose(left, q * rho, rtol=1e-10)


@pytest.mark.parametrize("spec", [*({"tempered": {"dl": dl}} for dl in (1.0, 0.5, 0.1, 0.01)), "iterated", "graded"])
def test_tempered_and_iterated_are_the_kalman_filter_for_linear_measurements(spec):
    p = linear_problem()
    F, H, _ = p.model.matrices
    est = build({"moments": "taylor", "update": spec}).run(p.model, p.y, **p.told)
    for i in range(5):
        x, P, _ = linear_filter(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., i])
        np.testing.assert_allclose(est.mean[..., i], x, atol=1e-10)
        np.testing.assert_allclose(est.cov[..., i % est.cov.shape[-1]], P, atol=1e-10)


def test_progressive_is_not_tempered():
    one = np.ones((1, 1))
    args = {"x": np.zeros(1), "P": 10 * one, "y": np.ones(1), "cov": one, "model": Scalar(), "dl": 0.1}
    progressive, tempered = (update(scheme, **args).P[0, 0, 0] / 10 for scheme in ("progressive", "tempered"))
    assert abs(progressive - 0.404457) < 1e-6 and abs(tempered - 0.090909) < 1e-6


@pytest.mark.parametrize("scheme", ["progressive", "tempered", "inflated"])
@pytest.mark.parametrize("dl", [0.3, 0.7, 0.15])
def test_a_step_that_does_not_divide_1_is_refused(scheme, dl):
    with pytest.raises(SpecError, match="whole number of sub-steps") as caught:
        build({"moments": "taylor", "update": {scheme: {"dl": dl}}})
    assert caught.value.path == ("update", scheme, "dl")
    if scheme == "progressive":
        with pytest.raises(SpecError, match="whole number"):
            build("pekf", dl=dl)


@pytest.mark.parametrize("moments", ["taylor", "unscented", "cubature", "divided_difference"])
@pytest.mark.parametrize("weight", ["none", "huber", "least_absolute"])
@pytest.mark.parametrize("scheme", [name for name in SCHEMES if name not in ("flow", "regression")])
def test_any_moments_go_with_any_weight_and_any_scheme(moments, weight, scheme):
    filt = build({"moments": moments, "weight": weight, "update": scheme})
    y = np.random.default_rng(0).normal([[2.0], [0.3]], 0.5, (4, 2, 6))
    est = filt.run(MODEL, y, X, P0, Q=0.2 * P0, R=R)
    assert not est.failed.any() and np.isfinite(est.cov).all()


def test_the_robust_weight_is_taken_anew_in_every_sub_step():
    scheme, dl = "progressive", 0.5
    x, P = X, P0
    for _ in range(2):
        H, nu = jac(x), oracle.residual(Y, h(x), MODEL.angles)
        w, V = np.linalg.eigh(R)
        L = V @ np.diag(np.sqrt(w)) @ V.T
        Rh = L @ np.diag(np.maximum(1, np.abs(np.linalg.inv(L) @ nu))) @ L
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + Rh)
        x, P = x + dl * K @ nu, P - dl * K @ H @ P
    after = update(scheme, weight={"huber": {"threshold": 1.0}}, dl=dl)
    np.testing.assert_allclose(after.x[:, 0], x, atol=1e-11)
    np.testing.assert_allclose(after.P[..., 0], P, atol=1e-11)
