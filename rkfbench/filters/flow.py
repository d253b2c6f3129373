"""The continuous update (35) of the PEKF paper, and a batched stand-in for it.

    dx/dlam = K nu,   dP/dlam = -K H P,   K = P H' R^-1,   lam from 0 to 1, with H and nu at the running mean

`Flow` integrates it run by run with a stiff solver: a reference for few runs. `Graded` takes it in tempered sub-steps
of growing length, all runs at once: each is implicit, so it is stable however stiff (35) is. (The paper prints K under
(35) and the matrices of (34) without the transpose of H.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Gt, Interval

from rkfbench.filters.base import Posterior
from rkfbench.filters.moments import Moments
from rkfbench.filters.schemes import look, portions
from rkfbench.filters.weights import Weight
from rkfbench.linalg import Array, batched, solve, sym, transpose
from rkfbench.models import Model


@dataclass(frozen=True)
class Flow:
    """The flow (35) by `scipy.integrate.solve_ivp`; `saturated` has H P H' + R for R in K, the limit of `progressive`
    as dl -> 0.

    What it shows of an update beside nu and S: `evaluations`, the number of right sides.
    """

    method: Annotated[Literal["LSODA", "Radau", "BDF"], "stiff method of solve_ivp"] = "LSODA"
    rtol: Annotated[float, Gt(0), "relative tolerance"] = 1e-9
    atol: Annotated[float, Gt(0), "absolute tolerance"] = 1e-10
    saturated: Annotated[bool, "K = P H' (H P H' + R)^-1, which is what `progressive` discretises"] = False

    sees: ClassVar[frozenset[str]] = frozenset({"evaluations"})

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        n, M = x.shape
        after, cov = np.full_like(x, np.nan), np.full((n, n, M), np.nan)
        evaluations = np.zeros((1, M))
        first = look(moments, weight, model, x, P, y, k, R)
        P, R = np.broadcast_to(P, cov.shape), np.broadcast_to(batched(R), (*R.shape[:2], M))
        for i in np.flatnonzero(np.isfinite(x).all(0) & np.isfinite(P).all((0, 1)) & np.isfinite(y).all(0)):
            one = slice(i, i + 1)
            state, evaluations[0, i] = self._integrate(
                moments, weight, model, x[:, one], P[..., one], y[:, one], k, R[..., one]
            )
            after[:, i], cov[..., i] = state[:n], sym(state[n:].reshape(n, n))
        return Posterior(after, cov, {**first.seen, "evaluations": evaluations})

    def _integrate(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> tuple[Array, int]:
        """Mean and covariance of one run at lam = 1, one after the other; NaN where the solver gives up."""
        from scipy.integrate import solve_ivp

        n = len(x)

        def right_side(_: float, state: Array) -> Array:
            P = state[n:].reshape(n, n, 1)
            at = look(moments, weight, model, state[:n, None], P, y, k, R)
            K = transpose(solve(at.Szz + at.R if self.saturated else batched(at.R), transpose(at.C)))
            return np.concatenate([(K[..., 0] @ at.nu[:, 0]), -(K[..., 0] @ at.C[..., 0].T).ravel()])

        start = np.concatenate([x[:, 0], P[..., 0].ravel()])
        result = solve_ivp(right_side, (0.0, 1.0), start, method=self.method, rtol=self.rtol, atol=self.atol)
        return (result.y[:, -1] if result.success else np.full_like(start, np.nan)), result.nfev


@dataclass(frozen=True)
class Graded:
    """`tempered` on a graded grid of pseudo-time: each sub-step `ratio` times the last, at most `cap`."""

    first: Annotated[float, Interval(gt=0, le=1), "length of the first sub-step"] = 1e-8
    ratio: Annotated[float, Gt(1), "growth from one sub-step to the next"] = 1.15
    cap: Annotated[float, Interval(gt=0, le=1), "longest sub-step"] = 0.03

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        return portions(list(grid(self.first, self.ratio, self.cap)), moments, weight, model, x, P, y, k, R)


@lru_cache
def grid(first: float, ratio: float, cap: float) -> tuple[float, ...]:
    """Lengths of the sub-steps, which add up to 1; the last one is what is left."""
    lengths, done, length = [], 0.0, min(first, cap)
    while done + length < 1:
        lengths.append(length)
        done += length
        length = min(length * ratio, cap)
    return (*lengths, 1 - done)
