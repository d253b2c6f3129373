"""Small test problems with full, non-diagonal covariances."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from rkfbench.models.base import Linear
from rkfbench.models.bearing import Bearing, bearing_slopes


def spd(n: int, seed: int, scale: float = 1.0) -> np.ndarray:
    """A full, well-conditioned symmetric positive definite matrix."""
    A = np.random.default_rng(seed).standard_normal((n, n))
    return scale * (A @ A.T / n + 0.5 * np.eye(n))


@dataclass(frozen=True)
class FullLinear(Linear):
    """A stable linear model with full F (4 x 4) and H (3 x 4)."""

    seed: int = 5
    states: ClassVar[tuple[str, ...]] = ("a", "b", "c", "d")
    measurements: ClassVar[tuple[str, ...]] = ("u", "v", "w")

    @cached_property
    def matrices(self):
        rng = np.random.default_rng(self.seed)
        F = rng.standard_normal((4, 4))
        return 0.95 * F / np.abs(np.linalg.eigvals(F)).max(), rng.standard_normal((3, 4)), None


@dataclass(frozen=True)
class Problem:
    model: FullLinear
    Q: np.ndarray
    R: np.ndarray
    P0: np.ndarray
    x0: np.ndarray
    y: np.ndarray

    @property
    def told(self) -> dict:
        return {"x0": self.x0, "P0": self.P0, "Q": self.Q, "R": self.R}


def linear_problem(runs: int = 5, steps: int = 12, seed: int = 1) -> Problem:
    """Full P0, Q, R and measurements with some outliers."""
    rng = np.random.default_rng(seed)
    y = rng.standard_normal((steps, 3, runs)) * 2
    y[rng.random((steps, 3, runs)) < 0.2] += 30
    return Problem(FullLinear(), spd(4, 2, 0.3), spd(3, 3), spd(4, 4, 2.0), rng.standard_normal(4), y)


@dataclass(frozen=True)
class Bent(Bearing):
    """A nonlinear model with a bearing: three states that turn into each other, one measurement that is an angle."""

    angle: str = "atan2_wrap"
    states: ClassVar[tuple[str, ...]] = ("a", "b", "c")
    measurements: ClassVar[tuple[str, ...]] = ("length", "bearing")
    bearings: ClassVar[tuple[int, ...]] = (1,)
    linear: ClassVar[bool] = False

    def f(self, x, k):
        a, b, c = x
        return np.stack([0.9 * a + 0.2 * np.sin(b), 0.8 * b + 0.1 * c * c, 0.7 * c + 0.3 * np.cos(a)])

    def h(self, x, k):
        a, b, c = x
        return np.stack([np.sqrt(1 + a * a + c * c), self.bearing(2 + a, b)])

    def F(self, x, k):
        a, b, c = x
        F = np.zeros((3, *x.shape))
        F[0, 0], F[0, 1], F[1, 1] = 0.9, 0.2 * np.cos(b), 0.8
        F[1, 2], F[2, 0], F[2, 2] = 0.2 * c, -0.3 * np.sin(a), 0.7
        return F

    def H(self, x, k):
        a, b, c = x
        r = np.sqrt(1 + a * a + c * c)
        H = np.zeros((2, *x.shape))
        H[0, 0], H[0, 2] = a / r, c / r
        H[1, 0], H[1, 1] = bearing_slopes(2 + a, b)
        return H
