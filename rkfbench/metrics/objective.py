"""The ALADKF as an approximate minimiser of J_k = sum_j lambda_{j,k}, eqs (12)-(36): how good are the approximations?

With d = k - j, Sigma_d of (14) and r_d = y_{k-d} - H F^-d x:  lambda_d = sqrt(r_d' Sigma_d^-1 r_d),  gradient of J_k =
- sum_d (H F^-d)' Sigma_d^-1 r_d / lambda_d. In the whitened terms of `influence`, h_d and v_d = h_d x - W_d y_{k-d}:
lambda_d = |v_d|, gradient = sum_d h_d' v_d/|v_d|.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.filters.weights import LeastAbsolute
from rkfbench.linalg import Array, solve
from rkfbench.metrics.base import Better, Each, Trial
from rkfbench.metrics.influence import inputs, reaches_back, window
from rkfbench.models import Model

NEWTON_STEPS = 60


@dataclass(frozen=True)
class _Objective(Each):
    """What both measurements need: only a filter with the weight lambda R has the objective J_k."""

    keep: ClassVar[frozenset[str]] = frozenset({"lambda"})
    at: tuple[int, ...] = (50,)
    better: ClassVar[Better | None] = "small"

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.array([k for k in self.at if k < T], dtype=np.intp)

    def applies(self, filt: object) -> bool:
        """The ALADKF, whatever its update scheme, and no filter of nonlinear moments with its weight."""
        return (
            isinstance(filt, GaussianFilter)
            and isinstance(filt.moments, Linear)
            and isinstance(filt.weight, LeastAbsolute)
        )

    def check(self, model: Model) -> None:
        """SpecError if the model has no such objective."""
        reaches_back(model)

    def terms(self, trial: Trial) -> tuple[Array, Callable[[int], Array]]:
        """h_d (K, m, n) up to the longest window, and by k what v_d is beside h_d x: W_d y_{k-d}, d = 0 .. k-1, with
        the part of a known input.
        """
        F, H, u = trial.experiment.assumed_model.matrices
        W, h, _ = window(F, H, trial.assumed.Q, trial.assumed.R, max(self.at) + 1)
        moved, y = inputs(F, H, u, W), trial.world.y

        def seen(k: int) -> Array:
            z: Array = W[:k] @ y[k - 1 :: -1]
            return z if moved is None else z + moved[:k]

        return h, seen


@dataclass(frozen=True)
class GradientRest(_Objective):
    """|gradient of J_{k+1} at F xhat_k - its new term| / |new term|: what (24) takes for zero, relative to what it
    keeps.
    """

    at: tuple[int, ...] = (5, 20, 50)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        h, seen = self.terms(trial)
        rows = []
        for k in self.steps(len(trial.world.y)).tolist():
            prediction = trial.experiment.assumed_model.f(trial.estimate.mean[k - 1], k + 1)
            v = h[: k + 1] @ prediction - seen(k + 1)
            parts = np.einsum("dij,dim->djm", h[: k + 1], v / np.sqrt((v * v).sum(1, keepdims=True)))
            rows.append(np.sqrt((parts[1:].sum(0) ** 2).sum(0) / (parts[0] ** 2).sum(0)))
        return np.array(rows)


@dataclass(frozen=True)
class ArgminDistance(_Objective):
    """|xhat_k - argmin J_k|; the minimum of the convex J_k by damped Newton steps on a smoothed objective."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        h, seen = self.terms(trial)
        rows = []
        for k in self.steps(len(trial.world.y)).tolist():
            best = minimise(h[:k], seen(k), trial.estimate.mean[k - 1])
            rows.append(np.sqrt(((trial.estimate.mean[k - 1] - best)[list(states)] ** 2).sum(0)))
        return np.array(rows)


def minimise(h: Array, z: Array, x: Array) -> Array:
    """argmin_x sum_d |h_d x - z_d| for h (K, m, n), z (K, m, M), from x (n, M): reweighted least squares with a floor
    that falls to 1e-9.

    A weight 1/max(|v_d|, floor) majorises the norm, so every step lowers the (floored) objective; it is convex, with
    one minimum.
    """
    K, m, n = h.shape
    flat = h.reshape(K * m, n)
    for step in range(NEWTON_STEPS):
        floor = max(1e-9, 10.0 ** (-step / 5))
        v = h @ x - z
        weight = 1 / np.maximum(np.sqrt((v * v).sum(1)), floor)
        normal = np.einsum("dij,dik,dm->jkm", h, h, weight, optimize=True)
        right = flat.T @ (weight[:, None] * z).reshape(K * m, -1)
        x = solve(normal, right)
    return x
