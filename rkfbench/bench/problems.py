"""The problems on which all implementations are timed: one linear, one nonlinear, and the same data for everybody.

The first runs of a wide problem are the narrow problem.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rkfbench import models
from rkfbench.linalg import Array
from rkfbench.noise.matrices import factor
from rkfbench.streams import GROUP, Streams

SEED = 7
THRESHOLD = 1.345  # of the Huber weight
PARTS = 10  # sub-steps of the progressive EKF
PARTICLES = 500
RATE, TIMES = 0.1, 10.0  # outliers of the linear problem: how often, and how many times the standard deviation


@dataclass(frozen=True)
class Problem:
    """A model, what the filters are told (x0, P0, Q, R), true states x (T, n, M) and measurements y (T, m, M)."""

    model: Any
    x0: Array
    P0: Array
    Q: Array
    R: Array
    x: Array
    y: Array

    @property
    def steps(self) -> int:
        return len(self.y)

    @property
    def runs(self) -> int:
        return self.y.shape[2]

    @property
    def by_run(self) -> Array:
        """Measurements (M, T, m), as those want them who take one run after the other."""
        return np.ascontiguousarray(self.y.transpose(2, 0, 1))

    @property
    def matrices(self) -> tuple[Array, Array]:
        """F and H of a linear model."""
        return self.model.F(self.x0, 1), self.model.H(self.x0, 1)

    def first(self, runs: int) -> Problem:
        """The first runs alone."""
        return replace(self, x=self.x[..., :runs], y=np.ascontiguousarray(self.y[..., :runs]))


def linear(runs: int, steps: int, outliers: bool = True) -> Problem:
    """n = 4, m = 3: planar motion, both positions and one velocity measured with correlated noise and outliers."""
    model = models.build({"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]})
    Q = 0.1 * np.kron([[1 / 12, 1 / 4], [1 / 4, 1]], np.eye(2)) + 0.01 * np.eye(4)
    R = np.array([[1.0, 0.3, 0.1], [0.3, 1.0, 0.2], [0.1, 0.2, 0.5]])
    return _simulated(model, np.array([0.0, 0.0, 1.0, 1.0]), np.eye(4), Q, R, runs, steps, outliers)


def altitude(runs: int, steps: int) -> Problem:
    """n = 6, m = 4: flight by bearing, range, height and range rate, away from the origin and within one quadrant.

    So no bearing ever comes near its cut, which most peers could not handle.
    """
    model = models.build({"kind": "altitude"})
    Q = 0.01 * np.kron([[5 / 3, 5 / 2], [5 / 2, 5]], np.eye(3))
    R = np.diag([0.001, 25.0, 25.0, 1.0])
    x0 = np.array([800.0, 800.0, 300.0, 5.0, 5.0, 0.5])
    return _simulated(model, x0, np.diag([25.0, 25.0, 25.0, 1.0, 1.0, 1.0]), Q, R, runs, steps, outliers=False)


def _simulated(model: Any, x0: Array, P0: Array, Q: Array, R: Array, runs: int, steps: int, outliers: bool) -> Problem:
    """x_0 ~ N(x0, P0), x_k = f(x_{k-1}) + w, y_k = h(x_k) + v; with outliers a share of the v is larger by far."""
    n, m = len(Q), len(R)
    draw = Streams(SEED, groups=-(-runs // GROUP))
    x = (x0[:, None] + factor(P0) @ draw.normal("start", n))[:, :runs]
    w = (factor(Q) @ draw.normal("process", steps, n))[..., :runs]
    v = (factor(R) @ draw.normal("measurement", steps, m))[..., :runs]
    if outliers:
        v *= np.where(draw.uniform("coin", steps, 1)[..., :runs] < RATE, TIMES, 1.0)
    X, y = np.empty_like(w), np.empty_like(v)
    for k in range(steps):
        x = X[k] = model.f(x, k + 1) + w[k]
        y[k] = model.h(x, k + 1) + v[k]
    return Problem(model, x0, P0, Q, R, X, y)
