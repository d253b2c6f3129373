"""KF, HKF and ALADKF: against naive twins, against FilterPy, and the exact checks of the ALADKF paper's note (numbers
in brackets are its).
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from rkfbench import filters, models
from rkfbench.errors import SpecError
from tests.oracles import linear as oracle
from tests.problems import linear_problem

TWINS = {
    "kf": ({}, oracle.reff_kf),
    "hkf": ({}, oracle.reff_hkf),
    "hkf cholesky": ({"root": "cholesky", "threshold": 0.7}, partial(oracle.reff_hkf, threshold=0.7, root="cholesky")),
    "aladkf": ({}, oracle.reff_aladkf),
}
A3 = 0.5 * np.eye(3) + 0.5
NAVIGATION = models.build({"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]})


def run(name, problem, y=None, keep=("cov", "S"), **changes):
    params, _ = TWINS.get(name, ({}, None))
    told = {**problem.told, **changes}
    return filters.build(name.split()[0], **params).run(problem.model, problem.y if y is None else y, keep=keep, **told)


@pytest.mark.parametrize("name", TWINS)
def test_one_step_equals_the_textbook_twin(name):
    p = linear_problem(steps=1)
    estimate = run(name, p)
    F, H, _ = p.model.matrices
    for i in range(p.y.shape[2]):
        x, P, S = oracle.linear_filter(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., i], TWINS[name][1])
        j = i % estimate.cov.shape[-1]
        np.testing.assert_allclose(estimate.mean[..., i], x, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(estimate.cov[..., j], P, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(estimate.extras["S"][0, ..., i % estimate.extras["S"].shape[-1]], S[0], rtol=1e-10)


@pytest.mark.parametrize("name", TWINS)
def test_a_trajectory_with_missing_measurements_equals_the_textbook_twin(name):
    p = linear_problem(steps=30)
    y = p.y.copy()
    y[4] = np.nan  # a missing measurement in all runs
    y[7, 1, 2] = y[9, 0, :3] = y[9, 2, 3] = np.nan
    y[11, :, 1] = np.nan
    estimate = run(name, p, y, keep=("cov",))
    F, H, _ = p.model.matrices
    for i in range(y.shape[2]):
        x, P, _ = oracle.linear_filter(F, H, p.Q, p.R, p.x0, p.P0, y[..., i], TWINS[name][1])
        np.testing.assert_allclose(estimate.mean[..., i], x, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(estimate.cov[..., i % estimate.cov.shape[-1]], P, rtol=1e-8, atol=1e-8)


def test_kf_equals_filterpy_over_a_trajectory():
    p = linear_problem(steps=50)
    estimate = run("kf", p)
    for i in range(p.y.shape[2]):
        peer = KalmanFilter(4, 3)
        peer.F, peer.H, _ = p.model.matrices
        peer.Q, peer.R, peer.x, peer.P = p.Q, p.R, p.x0.copy(), p.P0
        for k in range(len(p.y)):
            peer.predict()
            peer.update(p.y[k, :, i])
            np.testing.assert_allclose(estimate.mean[k, :, i], peer.x, rtol=1e-10, atol=1e-10)
            np.testing.assert_allclose(estimate.cov[k, ..., 0], peer.P, rtol=1e-10, atol=1e-10)


def test_a_huge_threshold_makes_the_hkf_the_kf_and_small_residuals_leave_R_alone():  # 1
    p = linear_problem()
    kf = run("kf", p)
    hkf = filters.build("hkf", threshold=1e9).run(p.model, p.y, **p.told, keep=("cov", "S"))
    for a, b in ((kf.mean, hkf.mean), (kf.cov, hkf.cov), (kf.extras["S"], hkf.extras["S"])):
        np.testing.assert_allclose(*np.broadcast_arrays(a, b), rtol=1e-9, atol=1e-12)
    quiet = filters.build("hkf").run(
        p.model, p.y * 1e-3, np.zeros(4), p.P0, Q=p.Q, R=p.R, keep=("S", "prior_cov", "inflation")
    )
    assert (quiet.extras["inflation"] == 1).all()


def test_lambda_is_a_norm_of_the_innovation_and_does_not_depend_on_the_root():  # 2
    p = linear_problem(steps=1)
    x0 = np.zeros(4)

    def lam(y, R):
        return filters.build("aladkf").run(p.model, y, x0, p.P0, Q=p.Q, R=R, keep=("lambda", "S", "prior_cov")).extras

    base, H = lam(p.y, p.R), p.model.matrices[1]
    nu = p.y[0]
    for i in range(nu.shape[1]):
        np.testing.assert_allclose(base["lambda"][0, 0, i] ** 2, nu[:, i] @ np.linalg.solve(p.R, nu[:, i]), rtol=1e-12)
        e = np.linalg.solve(oracle.symmetric_root(p.R), nu[:, i])
        np.testing.assert_allclose(base["lambda"][0, 0, i], np.linalg.norm(e), rtol=1e-12)
    np.testing.assert_allclose(lam(-3 * p.y, p.R)["lambda"], 3 * base["lambda"], rtol=1e-12)
    np.testing.assert_allclose(lam(p.y, 4 * p.R)["lambda"], base["lambda"] / 2, rtol=1e-12)
    HPH = H @ base["prior_cov"][0, ..., 0] @ H.T
    np.testing.assert_allclose(
        lam(p.y, 4 * p.R)["S"][0] - HPH[..., None], 2 * (base["S"][0] - HPH[..., None]), rtol=1e-9
    )


def test_lambda_of_one_is_the_kf_and_a_zero_innovation_trusts_the_measurement():  # 2
    p = linear_problem(steps=1, runs=1)
    y = p.y / np.sqrt(p.y[0, :, 0] @ np.linalg.solve(p.R, p.y[0, :, 0]))
    told = {**p.told, "x0": np.zeros(4)}
    one, kf = (filters.build(name).run(p.model, y, **told, keep=("cov", "S")) for name in ("aladkf", "kf"))
    np.testing.assert_allclose(one.mean, kf.mean, rtol=1e-9)
    np.testing.assert_allclose(one.cov, kf.cov, rtol=1e-9)
    H = p.model.matrices[1]
    zero = filters.build("aladkf").run(p.model, 0 * y, **told, keep=("cov", "S", "prior_cov"))
    np.testing.assert_allclose(zero.extras["S"][0, ..., 0], H @ zero.extras["prior_cov"][0, ..., 0] @ H.T, rtol=1e-12)
    np.testing.assert_allclose(H @ zero.cov[0, ..., 0] @ H.T, 0, atol=1e-12)
    assert not zero.failed.any()


@pytest.mark.parametrize("name", TWINS)
def test_information_form(name):  # 3
    p = linear_problem(steps=3)
    estimate = run(name, p, keep=("cov", "S", "prior_mean", "prior_cov"))
    H, M = p.model.matrices[1], p.y.shape[2]
    wide = {
        key: np.broadcast_to(value, (*value.shape[:-1], M))
        for key, value in {**estimate.extras, "cov": estimate.cov}.items()
    }
    for k in range(3):
        for i in range(M):
            Pbar, P, S = (wide[key][k, ..., i] for key in ("prior_cov", "cov", "S"))
            xbar, nu = estimate.extras["prior_mean"][k, :, i], p.y[k, :, i] - H @ estimate.extras["prior_mean"][k, :, i]
            Reff = S - H @ Pbar @ H.T
            np.testing.assert_allclose(
                np.linalg.inv(P), np.linalg.inv(Pbar) + H.T @ np.linalg.inv(Reff) @ H, rtol=1e-7, atol=1e-9
            )
            np.testing.assert_allclose(
                estimate.mean[k, :, i], xbar + P @ H.T @ np.linalg.solve(Reff, nu), rtol=1e-7, atol=1e-9
            )


def test_roots_and_condition_numbers_of_the_paper():  # 4
    root = oracle.symmetric_root(A3)
    assert root[0, 0] == pytest.approx(0.9428090416, abs=1e-10) and root[0, 1] == pytest.approx(0.2357022604, abs=1e-10)
    assert np.linalg.cond(root) == pytest.approx(2, rel=1e-12)
    assert np.linalg.cond(A3) == pytest.approx(4, rel=1e-12)
    assert np.linalg.cond(np.sqrt(A3)) == pytest.approx(8.2426406871, rel=1e-10)


@pytest.mark.parametrize("name", TWINS)
def test_scaling_data_and_covariances_together_scales_the_estimates(name):  # 5
    p, s = linear_problem(), 7.0
    base = run(name, p)
    scaled = run(name, p, s * p.y, x0=s * p.x0, P0=s**2 * p.P0, Q=s**2 * p.Q, R=s**2 * p.R)
    np.testing.assert_allclose(scaled.mean, s * base.mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(scaled.cov, s**2 * base.cov, rtol=1e-9)
    np.testing.assert_allclose(scaled.extras["S"], s**2 * base.extras["S"], rtol=1e-9)


@pytest.mark.parametrize("name", TWINS)
def test_shifting_the_trajectory_shifts_the_estimates(name):  # 5
    p, a = linear_problem(), np.array([3.0, -2.0, 1.0, 5.0])
    F, H, _ = p.model.matrices
    path = np.array([np.linalg.matrix_power(F, k) @ a for k in range(1, len(p.y) + 1)])
    shifted = run(name, p, p.y + (path @ H.T)[..., None], x0=p.x0 + a)
    np.testing.assert_allclose(shifted.mean - path[..., None], run(name, p).mean, rtol=1e-9, atol=1e-9)


class Transformed:
    """A model whose measurements are T y."""

    def __init__(self, model, T):
        self.model, self.T = model, T

    def __getattr__(self, name):
        return getattr(self.model, name)

    def h(self, x, k):
        return self.T @ self.model.h(x, k)

    def H(self, x, k):
        return self.T @ self.model.H(x, k)


def test_a_transformed_measurement_changes_the_hkf_only():  # 6
    p, T = linear_problem(), np.random.default_rng(3).standard_normal((3, 3))
    model = Transformed(p.model, T)
    for name, changes in (("kf", False), ("aladkf", False), ("hkf", True)):
        base = run(name, p).mean
        other = filters.build(name).run(model, T @ p.y, p.x0, p.P0, Q=p.Q, R=T @ p.R @ T.T).mean
        assert (np.abs(other - base).max() > 1e-3) == changes, name
        if not changes:
            np.testing.assert_allclose(other, base, rtol=1e-7, atol=1e-8)
    scaled = filters.build("hkf").run(Transformed(p.model, 3 * np.eye(3)), 3 * p.y, p.x0, p.P0, Q=p.Q, R=9 * p.R)
    np.testing.assert_allclose(scaled.mean, run("hkf", p).mean, rtol=1e-9, atol=1e-9)


def test_with_a_scalar_measurement_and_unit_threshold_the_hkf_inflates_by_max_1_lambda():  # 7
    model = models.build({"kind": "navigation", "dt": 0.5, "observed": ["px"]})
    p, R = linear_problem(), np.array([[0.6]])
    told = {"x0": p.x0, "P0": p.P0, "Q": p.Q, "R": R}
    hkf = filters.build("hkf", threshold=1.0).run(model, p.y[:, :1], **told, keep=("S", "prior_cov", "nu"))
    for k in range(len(p.y)):
        Reff = hkf.extras["S"][k, 0, 0] - hkf.extras["prior_cov"][k, 0, 0]
        lam = np.abs(hkf.extras["nu"][k, 0]) / np.sqrt(0.6)
        np.testing.assert_allclose(Reff, np.maximum(1, lam) * 0.6, rtol=1e-9)


def test_with_a_diagonal_R_both_roots_give_the_same_hkf():  # 8
    p, R = linear_problem(), np.diag([0.5, 2.0, 1.0])
    both = [
        filters.build("hkf", root=root).run(p.model, p.y, p.x0, p.P0, Q=p.Q, R=R).mean
        for root in ("symmetric", "cholesky")
    ]
    np.testing.assert_allclose(*both, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(
    ("factor", "first", "steady"), [(False, 1.7057264286, 2.1532792556), (True, 2.1389545580, 3.0141741063)]
)
def test_the_kfs_condition_number_does_not_depend_on_the_data_and_reaches_its_steady_value(factor, first, steady):  # 10
    R = A3 if factor else oracle.symmetric_root(A3)
    y = np.random.default_rng(1).standard_normal((60, 3, 4))
    S = filters.build("kf").run(NAVIGATION, y, np.zeros(4), np.eye(4), Q=np.eye(4), R=R, keep=("S",)).extras["S"]
    assert S.shape[-1] == 1
    assert np.linalg.cond(S[0, ..., 0]) == pytest.approx(first, rel=1e-10)
    assert np.linalg.cond(S[59, ..., 0]) == pytest.approx(steady, rel=1e-10)


def test_the_kfs_last_estimate_is_the_batch_least_squares_solution():  # 11
    p = linear_problem(steps=12, runs=2)
    F, H, _ = p.model.matrices
    kf = run("kf", p)
    for i in range(2):
        x, P = oracle.weighted_least_squares(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., i])
        np.testing.assert_allclose(kf.mean[-1, :, i], x, rtol=1e-8)
        np.testing.assert_allclose(kf.cov[-1, ..., 0], P, rtol=1e-8)


def test_a_covariance_that_changes_with_time_and_run_is_used_as_told():
    p = linear_problem(steps=6, runs=3)
    rng = np.random.default_rng(9)
    Q = p.Q[None, ..., None] * rng.uniform(0.5, 2, (6, 1, 1, 3))
    R = p.R[None, ..., None] * rng.uniform(0.5, 2, (6, 1, 1, 3))
    wide = filters.build("kf").run(p.model, p.y, p.x0, p.P0, Q=Q, R=R)
    for i in range(3):
        alone = filters.build("kf").run(p.model, p.y[..., i], p.x0, p.P0, Q=Q[..., i : i + 1], R=R[..., i : i + 1])
        np.testing.assert_allclose(wide.mean[..., i], alone.mean[..., 0], rtol=1e-10)


@pytest.mark.parametrize(
    ("change", "says"),
    [({"R": np.eye(2)}, "R has shape"), ({"x0": np.zeros(3)}, "x0 has shape"), ({"P0": np.eye(3)}, "P0 has shape")],
)
def test_shapes_that_do_not_fit_are_said(change, says):
    p = linear_problem()
    with pytest.raises(SpecError, match=says):
        filters.build("kf").run(p.model, p.y, **{**p.told, **change})
