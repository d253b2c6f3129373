"""Exact checks of the DAF paper: its weighted least-squares solution, and the one factor of the prediction."""

from __future__ import annotations

import numpy as np

from rkfbench.claims.checks import Check, Outcome
from rkfbench.filters.adaptive import Sensors, weighted_solution
from rkfbench.linalg import Array

H = np.array([[1.0, 0.0], [1.0, 0.0]])
RUNS = 1000


def _draws(seed: int) -> tuple[np.random.Generator, Array, Array]:
    """Prior covariances (N, 2, 2) and sensor variances (N, 2)."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((RUNS, 2, 2))
    return rng, A @ A.transpose(0, 2, 1) + 0.05 * np.eye(2), 10.0 ** rng.uniform(-1, 2, (RUNS, 2))


def gain_form() -> Outcome:
    """(beta (P-)^-1 + H' alpha R^-1 H)^-1 (beta (P-)^-1 x- + H' alpha R^-1 y) = x- + Kbar nu: largest relative
    difference.
    """
    rng, P, R = _draws(7)
    alpha, beta = rng.uniform(1e-3, 1, (RUNS, 2)), rng.uniform(1e-3, 1, RUNS)
    x, y = rng.standard_normal((RUNS, 2)), 5 * rng.standard_normal((RUNS, 2))
    prior, weight = beta[:, None, None] * np.linalg.inv(P), alpha / R
    information = prior + H.T @ (weight[:, :, None] * H)
    right = np.einsum("rij,rj->ri", prior, x) + (weight * y) @ H
    expected = np.linalg.solve(information, right[..., None])[..., 0]
    sensors = Sensors((y - x @ H.T).T, R.T, P[:, 0, 0])
    mean, cov = weighted_solution(x.T, np.moveaxis(P, 0, 2), H[0], sensors, alpha.T, beta[None])
    product = np.einsum("rij,jkr->rik", information, cov)
    deviation = max(np.abs(mean.T / expected - 1).max(), np.abs(product - np.eye(2)).max())
    return Outcome(float(deviation), 1e-9, f"{RUNS} random problems, mean and covariance")


def one_state_factor() -> Outcome:
    """V_X = Kbar nu over its sd from Kbar S Kbar': largest relative difference between its two components."""
    rng, P, R = _draws(9)
    alpha, nu = rng.uniform(1e-3, 1, (RUNS, 2)), rng.standard_normal((RUNS, 2))
    PH, noise = P @ H.T, R[:, :, None] * np.eye(2)
    K = PH @ np.linalg.inv(H @ PH + noise / alpha[:, :, None])
    sd = np.sqrt(np.einsum("rij,rjk,rik->ri", K, H @ PH + noise, K))
    u = np.abs(np.einsum("rij,rj->ri", K, nu)) / sd
    return Outcome(float(np.abs(u[:, 0] / u[:, 1] - 1).max()), 1e-9, f"{RUNS} random problems")


CHECKS: dict[str, Check] = {"E1": gain_form, "E2": one_state_factor}
