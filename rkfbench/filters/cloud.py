"""The particles of some runs: they move, are weighed, and are drawn again where few of them carry the weight."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench.linalg import Array, exp
from rkfbench.models import Model
from rkfbench.noise import Law
from rkfbench.streams import Onward


class Cloud:
    """The particles of some runs: x (n, M, N) with log weights (M, N), and the copies of x_j from step j on.

    `draw` is as wide as the particles of the runs of one case. With more runs than that, these are those of several
    cases, one case after the other, and what is drawn serves every case.
    """

    def __init__(
        self,
        model: Model,
        process: Law,
        measurement: Law,
        draw: Onward,
        mean: Array,
        L0: Array,
        particles: int,
        ess: float,
    ) -> None:
        self.model, self.process, self.measurement, self.draw = model, process, measurement, draw
        n, M = mean.shape
        self.runs = draw.runs // particles
        self.particles, self.threshold = particles, ess * particles
        self.x = self._moved(np.repeat(mean[..., None], particles, axis=-1), L0 @ draw.normal("start", n))
        self.copy: Array | None = None
        self.log = np.zeros((M, particles))
        self.weights = np.full((M, particles), 1 / particles)
        self.size = np.full(M, float(particles))
        self.dead = np.zeros(M, dtype=bool)
        self.offset = Onward(draw.seed, draw.first, 1, draw.scope, self.runs)

    def predict(self, k: int) -> None:
        """Move every particle with noise of its own."""
        w = self.process.sample(self.draw.within("process"), 1).value
        self.x = self._moved(self.model.f(self.x, k), w)

    def _moved(self, x: Array, noise: Array) -> Array:
        """x + noise; the particles of every case meet the same."""
        x = np.ascontiguousarray(x)
        cases = x.reshape(len(x), -1, self.runs, self.particles)
        cases += noise.reshape(len(x), 1, self.runs, self.particles)
        return x

    def remember(self) -> None:
        """Copy x_j."""
        self.copy = self.x.copy()

    def weigh(self, y: Array, k: int) -> None:
        """Multiply the weights by the likelihood of y (m, M); a missing component says nothing."""
        e = self.model.residual(y[..., None], self.model.h(self.x, k))
        self.log += self._likelihood(e, ~np.isnan(y))
        top = self.log.max(-1)
        self.dead |= ~np.isfinite(top + self.x.sum((0, 2)))
        self.log -= np.where(self.dead, 0.0, top)[:, None]
        W = exp(self.log.copy())
        W /= W.sum(-1, keepdims=True)
        if self.dead.any():
            W[self.dead] = np.nan
        self.weights, self.size = W, 1 / np.einsum("mp,mp->m", W, W)

    def _likelihood(self, e: Array, observed: np.ndarray) -> Array:
        if observed.all():
            return self.measurement.logpdf(e)
        total = np.zeros(e.shape[1:])
        patterns, which = np.unique(observed, axis=1, return_inverse=True)
        for i, pattern in enumerate(patterns.T):
            runs, rows = np.flatnonzero(which.reshape(-1) == i), np.flatnonzero(pattern)
            if len(rows):
                law: Any = self.measurement if pattern.all() else self.measurement.marginal(rows)  # type: ignore[attr-defined]
                total[runs] = law.logpdf(e[np.ix_(rows, runs)])
        return total

    def moments(self, names: Collection[str], prefix: str = "", of: Array | None = None) -> dict[str, Array]:
        """Weighted mean (n, M) and covariance (n, n, M) of the particles, or of their copies of x_j; those that are
        named.
        """
        x = self.x if of is None else of
        found = {}
        if {f"{prefix}mean", f"{prefix}cov"} & {*names}:
            found[f"{prefix}mean"] = mean = np.einsum("imp,mp->im", x, self.weights)
            if f"{prefix}cov" in names:
                d = x - mean[..., None]
                found[f"{prefix}cov"] = np.matmul(
                    (d * self.weights).transpose(1, 0, 2), d.transpose(1, 2, 0)
                ).transpose(1, 2, 0)
        return found

    @property
    def distinct(self) -> Array:
        """How many different copies of x_j are left, (M,): resampling keeps equal ones side by side."""
        if self.copy is None:
            return np.zeros(len(self.log))
        return 1.0 + np.count_nonzero(np.diff(self.copy[0], axis=-1), axis=-1)

    def resample(self) -> None:
        """Systematic resampling of the runs whose effective sample size is small: ceil(N cumsum(W) - u) particles up
        to each one.
        """
        u = self.offset.uniform("offset")
        low = (self.size < self.threshold) & ~self.dead
        if not low.any():
            return
        M, N = self.log.shape
        upto = np.cumsum(self.weights, axis=-1)
        upto *= N
        upto -= np.tile(u, M // self.runs)[:, None]
        np.minimum(np.ceil(upto, out=upto), N, out=upto)
        upto[:, -1] = N
        upto[~low] = np.arange(1, N + 1)  # every particle once
        upto += N * np.arange(M)[:, None]
        # the particle at each place is the number of those before it, of which one after the other is done with
        chosen = np.cumsum(np.bincount(upto.astype(np.intp).ravel(), minlength=M * N)[: M * N])
        self.x = self._taken(self.x, chosen)
        if self.copy is not None:
            self.copy = self._taken(self.copy, chosen)
        self.log[low] = 0.0
        self.weights[low] = 1 / N

    @staticmethod
    def _taken(x: Array, chosen: NDArray[np.intp]) -> Array:
        return x.reshape(len(x), -1).take(chosen, axis=1).reshape(x.shape)
