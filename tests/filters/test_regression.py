"""Huber regression filters: the closed forms and vectors of the NRUKF note, and their textbook twins."""

from __future__ import annotations

from math import erf, exp, pi, sqrt

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.models.base import Linear
from tests.oracles import huber as oracle
from tests.problems import linear_problem

G = 1.345


class Line(Linear):
    """H = [1] or [1 0], F = I."""

    def __init__(self, n):
        self.states = tuple("ab"[:n])
        self.measurements = ("y",)
        self.matrices = np.eye(n), np.eye(n)[:1], None


def update(spec, P, nu, **params):
    P = np.atleast_2d(np.array(P, float))
    n = len(P)
    post = build(spec, **params).correct(
        Line(n), np.zeros((n, 1)), P[..., None], np.array([[float(nu)]]), 1, np.ones((1, 1, 1))
    )
    return post.x[:, 0], post.P[..., 0], post.seen


def test_hubers_functions_have_the_values_of_the_note():
    assert [oracle.psi(e) for e in (-5, 1.345, 2.69)] == pytest.approx([0.269, 1, 0.5])
    inside, density = erf(G / sqrt(2)), exp(-G * G / 2) / sqrt(2 * pi)
    square = inside - 2 * G * density + G * G * (1 - inside)  # E[phi^2] at N(0, 1)
    assert inside**2 / square == pytest.approx(0.95000, abs=5e-6)


@pytest.mark.parametrize(
    ("nu", "kf", "m", "m_P", "r", "r_P", "y"),
    [
        (1, 0.8, 0.8, 0.8, 0.8, 0.8, 0.8),
        (5, 4, 4, 0.8, 2.591522, 1.926782, 1.076),
        (10, 8, 5.38, 1.848, 3.498049, 2.600780, 1.076),
        (-20, -16, -5.38, 2.924, -4.239559, 3.152088, -1.076),
        (100, 80, 5.38, 3.7848, 5.105333, 3.795787, 1.076),
    ],
)
def test_the_scalar_table_of_the_note(nu, kf, m, m_P, r, r_P, y):
    assert update("kf", 4, nu)[0][0] == pytest.approx(kf)
    x, P, seen = update("hkf_regression", 4, nu, state_rows="unit", passes=300)
    assert (x[0], P[0, 0]) == pytest.approx((m, m_P), abs=6e-7)
    x, P, seen = update({"moments": "linear", "weight": {"residual_huber": {}}}, 4, nu)
    assert (x[0], P[0, 0]) == pytest.approx((r, r_P), abs=6e-7)
    assert seen["S"][0, 0, 0] - 4 == pytest.approx(max(1, abs(nu) / G))
    x, P, seen = update({"moments": "linear", "weight": {"pseudo_observation": {}}}, 4, nu)
    assert (x[0], P[0, 0]) == pytest.approx((y * np.sign(nu) * np.sign(y), 0.8))


@pytest.mark.parametrize(
    ("nu", "rows", "root", "x", "P11"),
    [
        (10, "weighted", "cholesky", (9.3275, 2.331875), 0.93275),
        (10, "weighted", "symmetric", (9.319929, 1.673133), 0.931993),
        (10, "unit", "cholesky", (5.38, 1.345), 1.848), (10, "unit", "symmetric", (5.38, 1.345), 1.848),
        (100, "weighted", "cholesky", (99.3275, 24.831875), 0.993275),
        (100, "weighted", "symmetric", (99.319929, 15.215620), 0.993199),
        (100, "unit", "cholesky", (5.38, 1.345), 3.7848), (1, "weighted", "cholesky", (0.8, 0.2), 0.8),
        (1, "weighted", "symmetric", (0.8, 0.2), 0.8),
        (1, "unit", "cholesky", (0.8, 0.2), 0.8),
    ],
)  # fmt: skip
def test_the_two_state_vectors_of_the_note(nu, rows, root, x, P11):
    mean, P, seen = update("hkf_regression", [[4, 1], [1, 2]], nu, state_rows=rows, root=root, passes=400)
    np.testing.assert_allclose(mean, x, rtol=0, atol=6e-7)
    assert P[0, 0] == pytest.approx(P11, abs=6e-7)
    assert seen["last_change"][0, 0] < 1e-9


@pytest.mark.parametrize("form", ["residual_huber", "pseudo_observation"])
@pytest.mark.parametrize("nu", [0.5, 5, -40, 100])
def test_both_iterated_forms_converge_to_the_m_estimate(form, nu):
    P = np.array([[4.0, 1], [1, 2]])
    spec = {"moments": "linear", "weight": {form: {}}, "update": {"reweighted": {"passes": 400}}}
    x, _, seen = update(spec, P, nu)
    S = P[0, 0] + 1
    np.testing.assert_allclose(x, P[:, 0] / S * np.clip(nu, -G * S, G * S), rtol=1e-9)
    assert seen["last_change"][0, 0] < 1e-10


def test_far_outliers_move_the_r_form_and_the_m_estimate_alike_and_the_y_form_less():
    P = np.array([[4.0, 1], [1, 2]])
    far = 1e9
    for spec, params, share in [
        ("hkf_regression", {"state_rows": "unit", "passes": 100}, 1.0),
        ({"moments": "linear", "weight": {"residual_huber": {}}}, {}, 1.0),
        ({"moments": "linear", "weight": {"pseudo_observation": {}}}, {}, 1 / 5),
    ]:
        np.testing.assert_allclose(update(spec, P, far, **params)[0], share * G * P[:, 0], rtol=1e-6)


@pytest.mark.parametrize("params", [{}, {"state_rows": "unit"}, {"root": "symmetric"}])
def test_one_update_equals_the_textbook_regression(params):
    p = linear_problem(steps=1)
    H = p.model.matrices[1]
    kf = build("kf").run(p.model, p.y, **p.told, keep=("cov", "prior_mean", "prior_cov"))
    result = build("hkf_regression", **params).run(p.model, p.y, **p.told, keep=("cov", "nu"))
    options = {"unit_state": params.get("state_rows") == "unit", "root": params.get("root", "cholesky")}
    for i in range(p.y.shape[2]):
        x, P = kf.extras["prior_mean"][0, :, i], kf.extras["prior_cov"][0, ..., 0]
        expected, cov = oracle.regression(x, P, H, p.R, p.y[0, :, i] - H @ x, **options)
        np.testing.assert_allclose(result.mean[0, :, i], expected, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(result.cov[0, ..., i], cov, rtol=1e-10, atol=1e-10)
    assert np.abs(result.mean - kf.mean).max() > 0.1


def test_trajectories_equal_those_of_the_textbook_regression():
    p = linear_problem(steps=10, runs=3)
    F, H, _ = p.model.matrices
    result = build("hkf_regression").run(p.model, p.y, **p.told)
    for i in range(3):
        x, P = p.x0, p.P0
        for k in range(10):
            x, P = F @ x, F @ P @ F.T + p.Q
            x, P = oracle.regression(x, P, H, p.R, p.y[k, :, i] - H @ x)
            np.testing.assert_allclose(result.mean[k, :, i], x, rtol=1e-8, atol=1e-8)


def test_least_squares_on_the_stacked_rows_is_the_kalman_filter():
    p = linear_problem()
    kf = build("kf").run(p.model, p.y, **p.told)
    free = build("hkf_regression", threshold=1e9).run(p.model, p.y, **p.told)
    np.testing.assert_allclose(free.mean, kf.mean, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(free.cov, np.broadcast_to(kf.cov, free.cov.shape), rtol=1e-10, atol=1e-11)


@pytest.mark.parametrize("seed", range(4))
def test_the_solution_with_given_weights_is_the_gain_form(seed):
    """(14)-(15) = (20)-(22) for any positive weights."""
    rng = np.random.default_rng(seed)
    p = linear_problem(steps=1)
    H, P, R = p.model.matrices[1], p.P0, p.R
    y, x = rng.standard_normal(3), rng.standard_normal(4)
    wy, wx = rng.uniform(0.05, 1, 3), rng.uniform(0.05, 1, 4)
    Sr, Sp = np.linalg.cholesky(R), np.linalg.cholesky(P)
    M = np.vstack([np.linalg.inv(Sr) @ H, np.linalg.inv(Sp)])
    Psi = np.diag(np.concatenate([wy, wx]))
    Y = np.concatenate([np.linalg.inv(Sr) @ y, np.linalg.inv(Sp) @ x])
    cov = np.linalg.inv(M.T @ Psi @ M)
    Pt, Rt = Sp @ np.diag(1 / wx) @ Sp.T, Sr @ np.diag(1 / wy) @ Sr.T
    K = Pt @ H.T @ np.linalg.inv(H @ Pt @ H.T + Rt)
    np.testing.assert_allclose(cov @ M.T @ Psi @ Y, x + K @ (y - H @ x), rtol=1e-10)
    np.testing.assert_allclose(cov, (np.eye(4) - K @ H) @ Pt, rtol=1e-9, atol=1e-12)


def test_the_regression_takes_no_second_weight():
    p = linear_problem(steps=1)
    with pytest.raises(SpecError, match="its own weight"):
        build({"moments": "linear", "weight": "huber", "update": "regression"}).run(p.model, p.y, **p.told)


def test_a_missing_component_is_a_missing_row():
    p = linear_problem(steps=1, runs=2)
    y = p.y.copy()
    y[0, 1] = np.nan
    kf = build("kf").run(p.model, y, **p.told, keep=("prior_mean", "prior_cov"))
    result = build("hkf_regression").run(p.model, y, **p.told)
    rows = [0, 2]
    H = p.model.matrices[1][rows]
    for i in range(2):
        x, P = kf.extras["prior_mean"][0, :, i], kf.extras["prior_cov"][0, ..., 0]
        expected, _ = oracle.regression(x, P, H, p.R[np.ix_(rows, rows)], y[0, rows, i] - H @ x)
        np.testing.assert_allclose(result.mean[0, :, i], expected, rtol=1e-10)
