"""Influence functions of KF, HKF and ALADKF, eqs (59)-(77) of the ALADKF paper, at full window length.

About the true state c = x_k, with d = k - j = 0 .. k-1 and B_d = B_{d-1} + F^-d Q F^-d', B_0 = 0:

    Sigma_d = H B_d H' + R,  W_d = Sigma_d^(-1/2),  h_d = W_d H F^-d,  v_{k-d} = W_d (H F^-d c - y_{k-d}),  G_k = sum_d
    h_d' h_d
    KF      IF = G_k^-1 sum_d h_d' v                       (67)
    HKF     IF = (xi G_k)^-1 sum_d h_d' clip(v, +-beta)    (68), (70)-(73)
    ALADKF  IF = (xi G_k)^-1 sum_d h_d' v/|v|              (69), (74)-(77)

xi are the integrals (66) under the body law v ~ N(0, I). F^-d reaches back as (61) says; old data are never cut off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import erf, gamma, sqrt

import numpy as np
from numpy.typing import NDArray

from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.filters.weights import Huber, LeastAbsolute, Plain, Weight
from rkfbench.linalg import Array
from rkfbench.metrics.base import Each, Trial

TOGETHER = 100  # lags d that are summed up at once: they stay in the cache


@dataclass(frozen=True)
class InfluenceNorm(Each):
    """Euclidean norm of the influence function, (81) over all n states, at k = 10, 20, ..., T."""

    every: int = 10

    def applies(self, filt: object) -> bool:
        """Only KF, HKF and ALADKF have an influence function here."""
        weights = (Plain, Huber, LeastAbsolute)
        return (
            isinstance(filt, GaussianFilter) and isinstance(filt.moments, Linear) and isinstance(filt.weight, weights)
        )

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.arange(self.every, T + 1, self.every)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        experiment, ks = trial.experiment, self.steps(len(trial.world.y))
        F, H, _ = experiment.assumed_model.matrices
        IF = influence(trial.filter.weight, F, H, experiment.Q, experiment.R, trial.world.x, trial.world.y, ks)
        return np.sqrt((IF[:, states] ** 2).sum(1))


def influence(
    weight: Weight, F: Array, H: Array, Q: Array, R: Array, x: Array, y: Array, ks: Sequence[int] | Array
) -> Array:
    """The influence function (K, n, M) at the steps ks about the states x (T, n, M), for measurements y (T, m, M)."""
    W, h, G = window(F, H, Q, R, int(max(ks)))
    xi = xi_of(weight, len(H))
    (T, _, M), n = y.shape, len(F)
    backwards = np.ascontiguousarray(y[::-1])  # y_{k-d} for d = 0, 1, ..
    result = np.empty((len(ks), n, M))
    for i, k in enumerate(ks):
        total = np.zeros((n, M))
        for some in (slice(d, min(d + TOGETHER, k)) for d in range(0, k, TOGETHER)):
            v = h[some] @ x[k - 1]
            v -= W[some] @ backwards[T - k :][some]
            total += h[some].reshape(-1, n).T @ psi(weight, v).reshape(-1, M)
        result[i] = np.linalg.solve(xi * G[k - 1], total)
    return result


def window(F: Array, H: Array, Q: Array, R: Array, length: int) -> tuple[Array, Array, Array]:
    """W_d (length, m, m), h_d (length, m, n) and G_k (length, n, n), which depend on d = k - j only."""
    return _window(*(A.shape for A in (F, H)), *(np.ascontiguousarray(A).tobytes() for A in (F, H, Q, R)), length)


@lru_cache(maxsize=16)
def _window(
    f_shape: tuple[int, ...], h_shape: tuple[int, ...], f: bytes, h: bytes, q: bytes, r: bytes, length: int
) -> tuple[Array, Array, Array]:
    (m, n), F, H = h_shape, np.frombuffer(f).reshape(f_shape), np.frombuffer(h).reshape(h_shape)
    Q, R = np.frombuffer(q).reshape(n, n), np.frombuffer(r).reshape(m, m)
    back, power, B = np.linalg.inv(F), np.eye(n), np.zeros((n, n))
    W, hs = np.empty((length, m, m)), np.empty((length, m, n))
    for d in range(length):
        w, V = np.linalg.eigh(H @ B @ H.T + R)
        W[d] = (V / np.sqrt(w)) @ V.T
        hs[d] = W[d] @ H @ power
        power = power @ back
        B = B + power @ Q @ power.T
    return W, hs, np.cumsum(np.einsum("dij,dik->djk", hs, hs), axis=0)


def psi(weight: Weight, v: Array) -> Array:
    """The score phi(v) of (63) for v (K, m, M): v, v clipped by component (73), or v/|v| (77)."""
    if isinstance(weight, Huber):
        return np.clip(v, -weight.threshold, weight.threshold)
    if isinstance(weight, LeastAbsolute):
        length = np.sqrt(np.einsum("dmM,dmM->dM", v, v))
        length[length == 0] = 1
        return v / length[:, None]
    return v


def xi_of(weight: Weight, m: int) -> float:
    """The integral (66) under v ~ N(0, I_m): 1; P(|v_i| < beta) = erf(beta/sqrt 2); (1 - 1/m) E[1/|v|]."""
    if isinstance(weight, Huber):
        return erf(weight.threshold / sqrt(2))
    if isinstance(weight, LeastAbsolute):
        return (1 - 1 / m) * gamma((m - 1) / 2) / (sqrt(2) * gamma(m / 2))
    return 1.0
