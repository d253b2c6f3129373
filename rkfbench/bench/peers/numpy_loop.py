"""Textbook NumPy, one run after the other, where no library has the filter: progressive EKF and particle filter."""

from __future__ import annotations

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, one_state, time_first
from rkfbench.bench.problems import PARTICLES, PARTS, SEED, Problem
from rkfbench.linalg import Array


def missing() -> None:
    """Always there."""


def progressive(problem: Problem) -> Task:
    """Sub-steps x + dl K nu, P - dl K H P with K = P H' (H P H' + R)^-1."""
    F = problem.model.F(problem.x0, 1)
    f, h = one_state(problem)
    y = problem.by_run

    def slopes(x: Array) -> Array:
        H = np.zeros((4, 6))
        p, v = x[:3], x[3:]
        ground, r = p[0] ** 2 + p[1] ** 2, np.sqrt(p @ p)
        H[0, :2] = -p[1] / ground, p[0] / ground
        H[1, :3] = H[3, 3:] = p / r
        H[2, 2] = 1.0
        H[3, :3] = (v - (p @ v) / r**2 * p) / r
        return H

    def call() -> Array:
        means = np.empty((*y.shape[:2], 6))
        for r, run in enumerate(y):
            x, P = problem.x0, problem.P0
            for k, yk in enumerate(run):
                x, P = f(x), F @ P @ F.T + problem.Q
                for _ in range(PARTS):
                    H = slopes(x)
                    K = np.linalg.solve(H @ P @ H.T + problem.R, H @ P).T / PARTS
                    nu = yk - h(x)
                    nu[0] = (nu[0] + np.pi) % (2 * np.pi) - np.pi
                    x, P = x + K @ nu, P - K @ H @ P
                means[r, k] = x
        return means

    return Task(call, time_first)


def particles(problem: Problem) -> Task:
    """Bootstrap particle filter, the particles of one run (N, n) at once, with systematic resampling."""
    F, H = problem.matrices
    start, process = np.linalg.cholesky(problem.P0), np.linalg.cholesky(problem.Q)
    information = np.linalg.inv(problem.R)
    y, N = problem.by_run, PARTICLES
    rng = np.random.default_rng(SEED)

    def call() -> Array:
        means = np.empty((*y.shape[:2], 4))
        for r, run in enumerate(y):
            x, logs = problem.x0 + rng.standard_normal((N, 4)) @ start.T, np.zeros(N)
            for k, yk in enumerate(run):
                x = x @ F.T + rng.standard_normal((N, 4)) @ process.T
                nu = yk - x @ H.T
                logs -= 0.5 * np.einsum("pi,ij,pj->p", nu, information, nu)
                W = np.exp(logs - logs.max())
                W /= W.sum()
                means[r, k] = W @ x
                if 1 / (W @ W) < N / 2:
                    at = np.searchsorted(np.cumsum(W), (np.arange(N) + rng.random()) / N)
                    x, logs = x[np.minimum(at, N - 1)], np.zeros(N)
        return means

    return Task(call, time_first)


PEERS = (
    Peer("NumPy loop", "pekf", progressive, most=2),
    Peer("NumPy loop", "pf", particles, most=50),
)
