"""Gaussian noise, given by its covariance, by a factor that multiplies unit normals, or by standard deviations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rkfbench.linalg import Array
from rkfbench.noise.base import Sample, gaussian_logpdf
from rkfbench.noise.matrices import factor
from rkfbench.streams import Streams


@dataclass(frozen=True, eq=False)
class Gaussian:
    """N(0, L L') with e = L g, g ~ N(0, I)."""

    L: Array

    @classmethod
    def of(cls, C: Array) -> Gaussian:
        """N(0, C)."""
        return cls(factor(C))

    @property
    def dim(self) -> int:
        return len(self.L)

    @property
    def cov(self) -> Array:
        return self.L @ self.L.T

    @property
    def parts(self) -> Mapping[str, Array]:
        return {}

    def sample(self, draw: Streams, steps: int) -> Sample:
        value = self.L @ draw.normal("normal", steps, self.dim)
        return Sample(value, lambda: self.cov[None, ..., None])

    def logpdf(self, e: Array) -> Array:
        return gaussian_logpdf(e, self.cov)

    def marginal(self, rows: Array) -> Gaussian:
        """The law of some components."""
        return Gaussian.of(self.cov[np.ix_(rows, rows)])
