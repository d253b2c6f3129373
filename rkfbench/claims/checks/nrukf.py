"""Exact checks of the NRUKF paper: the update as a regression, what Huber's cost touches, and bounded influence."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from rkfbench.claims.checks import Check, Outcome
from rkfbench.filters import build
from rkfbench.linalg import Array
from rkfbench.models.base import Linear

PRIORS = (np.array([[4.0]]), np.array([[4.0, 1.0], [1.0, 2.0]]))  # R = 1, H = [1] and [1 0], x- = 0
PASSES = 400  # of the iteration, enough to converge where H P- H' is four times R
PLAIN = {"moments": "linear"}
FILTERS: dict[str, dict[str, Any]] = {
    "KF": PLAIN,
    "HUKF": {"use": "hkf_regression", "passes": PASSES},
    "HUKF0": {"use": "hkf_regression", "passes": PASSES, "state_rows": "unit"},
    "NRUKF_R": {**PLAIN, "weight": "residual_huber"},
    "NRUKF_Y": {**PLAIN, "weight": "pseudo_observation"},
}  # on a linear model, where unscented moments are exact


class _FirstState(Linear):
    """n states that stay, the first of them measured."""

    measurements = ("y",)

    def __init__(self, n: int) -> None:
        self.states = tuple(f"x{i + 1}" for i in range(n))
        self.matrices = np.eye(n), np.eye(n)[:1], None


def _update(name: str, P: Array, nu: Array) -> tuple[Array, Array]:
    """x+ (n, N) and P+ (n, n, N or 1) of one update from x- = 0 for the innovations nu (N,)."""
    n = len(P)
    x, y = np.zeros((n, len(nu))), nu[None]
    filt: Any = build(FILTERS[name])
    after = filt.correct(_FirstState(n), x, P[..., None], y, 1, np.ones((1, 1, 1)))
    return after.x, after.P


def state_weights() -> Outcome:
    """(14)-(15) with all rows weighted against (23)-(24), converged: largest difference of x+ in the two-state
    vectors.
    """
    nu = np.array([1.0, 10.0, 100.0])
    weighted, unit = (_update(name, PRIORS[1], nu)[0] for name in ("HUKF", "HUKF0"))
    apart = np.abs(weighted - unit).max(0)
    shown = ", ".join(f"{d:.4g} at nu = {v:g}" for d, v in zip(apart, nu, strict=True))
    return Outcome(float(apart.max()), 1e-6, f"difference of x+: {shown}")


def least_squares() -> Outcome:
    """The Kalman update solves the whitened regression (8)-(10): largest difference on random systems, n = 4, m = 2."""
    rng, runs, n, m = np.random.default_rng(10), 500, 4, 2
    A, B = rng.standard_normal((runs, n, n)), rng.standard_normal((runs, m, m))
    P, R = A @ A.transpose(0, 2, 1) + 0.1 * np.eye(n), B @ B.transpose(0, 2, 1) + 0.1 * np.eye(m)
    H, x, y = rng.standard_normal((runs, m, n)), rng.standard_normal((runs, n)), rng.standard_normal((runs, m))
    Mx, My = np.linalg.inv(np.linalg.cholesky(P)), np.linalg.inv(np.linalg.cholesky(R))
    M = np.concatenate([My @ H, Mx], axis=1)
    Y = np.concatenate([(My @ y[..., None])[..., 0], (Mx @ x[..., None])[..., 0]], axis=1)
    cov = np.linalg.inv(M.transpose(0, 2, 1) @ M)
    solution = np.einsum("rij,rkj,rk->ri", cov, M, Y)
    S = H @ P @ H.transpose(0, 2, 1) + R
    K = P @ H.transpose(0, 2, 1) @ np.linalg.inv(S)
    kalman = x + np.einsum("rij,rj->ri", K, y - np.einsum("rij,rj->ri", H, x))
    deviation = max(np.abs(solution - kalman).max(), np.abs(cov - (P - K @ H @ P)).max())
    return Outcome(float(deviation), 1e-8, f"{runs} random systems, mean and covariance")


def influence(name: str) -> Outcome:
    """|x1+ - x1-| over nu = 10 .. 1e6 in the scalar and the two-state model: relative growth from 1e5 to 1e6."""
    nu = 10.0 ** np.arange(1, 7)
    shifts = [np.abs(_update(name, P, nu)[0][0]) for P in PRIORS]
    growth = [float(shift[-1] / shift[-2] - 1) for shift in shifts]
    last = ", ".join(f"{shift[-1]:.4g}" for shift in shifts)
    return Outcome(max(*growth, 0.0), 0.01, f"shift at nu = 1e6, one and two states: {last}")


CHECKS: dict[str, Check] = {"C6": state_weights, "C7": least_squares} | {
    f"C8-{name}": partial(influence, name) for name in FILTERS
}
