"""Influence functions of KF, HKF and ALADKF, eqs (59)-(77) of the ALADKF paper, at full window length.

About a point c, with d = k - j = 0 .. k-1 and B_d = B_{d-1} + F^-d Q F^-d', B_0 = 0:

    Sigma_d = H B_d H' + R,  W_d = Sigma_d^(-1/2),  h_d = W_d H F^-d,  v_{k-d} = W_d (H F^-d c - y_{k-d}),  G_k = sum_d
    h_d' h_d
    KF      IF = G_k^-1 sum_d h_d' v                       (67)
    HKF     IF = (xi G_k)^-1 sum_d h_d' clip(v, +-beta)    (68), (70)-(73)
    ALADKF  IF = (xi G_k)^-1 sum_d h_d' v/|v|              (69), (74)-(77)

c is the true state x_k, or the filter's own estimate, as (61) prints. xi are the integrals (66) under the body law
v ~ N(0, I); read literally, (71) puts those of the HKF inside the sum, xi where |v_i| < beta and 0 elsewhere, and the
matrix may be singular: then its pseudo-inverse stands for the inverse. F^-d reaches back as (61) says; old data are
never cut off. A known input u moves x_{k-d} = F^-d x_k - s_d, s_d = sum_i=1..d F^-i u, so v has -W_d H s_d beside it.
Where G_k is singular (k = 1, a pair F, H that cannot be observed) there is no influence function: NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import erf, gamma, sqrt
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.filters.weights import Huber, LeastAbsolute, Plain, Weight
from rkfbench.linalg import Array, content, mul
from rkfbench.metrics.base import Better, Each, Trial
from rkfbench.models import Model

TOGETHER = 100  # lags d that are summed up at once: they stay in the cache
SINGULAR = 1e-12  # eigenvalues below this share of the largest are zero


About = Literal["truth", "own"]
Xi = Literal["expected", "literal"]


@dataclass(frozen=True)
class InfluenceFunction(Each):
    """The influence function of all n states at k = 10, 20, ..., T: (K, n, M)."""

    every: int = 10
    about: About = "truth"
    xi: Xi = "expected"

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.arange(self.every, T + 1, self.every)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        told, ks = trial.assumed, self.steps(len(trial.world.y))
        F, H, u = trial.experiment.assumed_model.matrices
        c = trial.world.x if self.about == "truth" else trial.estimate.mean
        return influence(trial.filter.weight, F, H, told.Q, told.R, c, trial.world.y, ks, u=u, xi=self.xi)


@dataclass(frozen=True)
class InfluenceNorm(InfluenceFunction):
    """Euclidean norm of the influence function, (81) over all n states, at k = 10, 20, ..., T."""

    better: ClassVar[Better | None] = "small"

    def applies(self, filt: object) -> bool:
        """Only KF, HKF and ALADKF have an influence function here."""
        weights = (Plain, Huber, LeastAbsolute)
        return (
            isinstance(filt, GaussianFilter) and isinstance(filt.moments, Linear) and isinstance(filt.weight, weights)
        )

    def check(self, model: Model) -> None:
        """SpecError if the model has no influence functions."""
        reaches_back(model)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        IF = trial.quantity(InfluenceFunction(self.every, self.about, self.xi), ())  # once, whatever states are wanted
        return np.sqrt((IF[:, states] ** 2).sum(1))


def reaches_back(model: Model) -> None:
    """SpecError if a linear model has no F^-1, or no constant matrices at all."""
    if model.linear and np.linalg.matrix_rank(F := model.matrices[0]) < len(F):  # type: ignore[attr-defined]
        raise SpecError("needs the inverse of F, which this model does not have")


def influence(
    weight: Weight,
    F: Array,
    H: Array,
    Q: Array,
    R: Array,
    c: Array,
    y: Array,
    ks: Sequence[int] | Array,
    u: Array | None = None,
    xi: Xi = "expected",
) -> Array:
    """The influence function (K, n, M) at the steps ks about the states c (T, n, M), for measurements y (T, m, M)."""
    length = int(max(ks))
    W, h, G = window(F, H, Q, R, length)
    moved = inputs(F, H, u, W)
    constant, literal = xi_of(weight, len(H)), xi == "literal" and isinstance(weight, Huber)
    (T, _, M), n = y.shape, len(F)
    backwards = np.ascontiguousarray(y[::-1])  # y_{k-d} for d = 0, 1, ..
    products = (h[..., None] * h[:, :, None]).reshape(length, -1, n * n) if literal else None
    result = np.full((len(ks), n, M), np.nan)
    regular = np.linalg.matrix_rank(G[np.asarray(ks) - 1], hermitian=True) == n
    for i, k in enumerate(ks):
        if not regular[i]:
            continue
        total, inside = np.zeros((n, M)), np.zeros((n * n, M))
        for some in (slice(d, min(d + TOGETHER, k)) for d in range(0, k, TOGETHER)):
            v = h[some] @ c[k - 1]
            v -= W[some] @ backwards[T - k :][some]
            if moved is not None:
                v -= moved[some]
            total += h[some].reshape(-1, n).T @ psi(weight, v).reshape(-1, M)
            if products is not None:
                counts = np.abs(v) < weight.threshold  # type: ignore[attr-defined]
                inside += products[some].reshape(-1, n * n).T @ counts.reshape(-1, M).astype(float)
        if literal:
            result[i] = solve_singular(constant * inside.reshape(n, n, M), total)
        else:
            result[i] = np.linalg.solve(constant * G[k - 1], total)
    return result


def solve_singular(A: Array, b: Array) -> Array:
    """A^+ b for symmetric A (n, n, M) and b (n, M), A^+ the pseudo-inverse."""
    inverse = np.linalg.pinv(np.moveaxis(A, 2, 0), rcond=SINGULAR, hermitian=True)
    return mul(np.ascontiguousarray(np.moveaxis(inverse, 0, 2)), b)


def inputs(F: Array, H: Array, u: Array | None, W: Array) -> Array | None:
    """W_d H s_d (length, m, 1), s_d = F^-1 (u + s_{d-1}), s_0 = 0: what a known input does to v; None without one."""
    if u is None or not u.any():
        return None
    back, s = np.linalg.inv(F), np.zeros((len(W), len(F), 1))
    for d in range(1, len(W)):
        s[d] = back @ (u[:, None] + s[d - 1])
    return W @ H @ s


def window(F: Array, H: Array, Q: Array, R: Array, length: int) -> tuple[Array, Array, Array]:
    """W_d (length, m, m), h_d (length, m, n) and G_k (length, n, n), which depend on d = k - j only."""
    return _window(*(A.shape for A in (F, H)), *map(content, (F, H, Q, R)), length)


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
    """The integral (66) under v ~ N(0, I_m): 1; P(|v_i| < beta) = erf(beta/sqrt 2); (1 - 1/m) E[1/|v|], which for
    m = 1 is its limit sqrt(2/pi), twice the density of v at 0, where sign(v) jumps by 2.
    """
    if isinstance(weight, Huber):
        return erf(weight.threshold / sqrt(2))
    if isinstance(weight, LeastAbsolute):
        return 2 / m * gamma((m + 1) / 2) / (sqrt(2) * gamma(m / 2))
    return 1.0
