"""Contaminated noise, (8) and (80) of the ALADKF paper: (1 - rate) body + rate outliers.

joint coin:      one coin a vector decides for all components.
component coin:  a full body vector and a full outlier vector are drawn, and a coin a component picks the entry.

The coins are uniforms compared with the rate, so the outliers at a small rate are a subset of those at a larger one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from rkfbench.linalg import Array
from rkfbench.noise.base import Law, Sample
from rkfbench.streams import Streams


@dataclass(frozen=True, eq=False)
class Contaminated:
    """Body noise in which each vector (joint) or component is replaced by an outlier with probability `rate`."""

    rate: float
    body: Any
    outliers: Any
    joint: bool = True

    @property
    def dim(self) -> int:
        return int(self.body.dim)

    @property
    def cov(self) -> Array:
        """Covariance of the mixture; with component coins the off-diagonal elements meet only where both coins
        agree.
        """
        p, C1, C2 = self.rate, self.body.cov, self.outliers.cov
        if self.joint:
            return (1 - p) * C1 + p * C2
        mixed = (1 - p) ** 2 * C1 + p**2 * C2
        np.fill_diagonal(mixed, (1 - p) * np.diag(C1) + p * np.diag(C2))
        return mixed

    @property
    def parts(self) -> Mapping[str, Array]:
        """`body`; `mixture`: (1 - rate) C1 + rate C2 whatever the coins are."""
        return {"body": self.body.cov, "mixture": (1 - self.rate) * self.body.cov + self.rate * self.outliers.cov}

    def sample(self, draw: Streams, steps: int) -> Sample:
        body = self.body.sample(draw.within("body"), steps)
        outlier = self.outliers.sample(draw.within("outlier"), steps)
        u = draw.uniform("coin", steps) if self.joint else draw.uniform("coins", steps, self.dim)
        flags = u < self.rate
        pick = flags[:, None] if self.joint else flags

        def cov() -> Array:
            if self.joint:
                return np.where(flags[:, None, None], outlier.cov(), body.cov())
            both = pick[:, :, None] & pick[:, None]
            neither = ~pick[:, :, None] & ~pick[:, None]
            return np.where(both, outlier.cov(), np.where(neither, body.cov(), 0.0))

        return Sample(np.where(pick, outlier.value, body.value), cov, flags=flags)

    def logpdf(self, e: Array) -> Array:
        """log((1 - p) f_body + p f_outlier); with component coins the sum over all patterns of coins."""
        with np.errstate(divide="ignore"):
            keep, swap = np.log1p(-self.rate), np.log(self.rate)
        if self.joint:
            return np.logaddexp(keep + self.body.logpdf(e), swap + self.outliers.logpdf(e))
        total = np.full(e.shape[1:], -np.inf)
        for coins in product((False, True), repeat=self.dim):
            hit = np.array(coins)
            weight = hit.sum() * swap if hit.any() else 0.0
            weight += (~hit).sum() * keep if (~hit).any() else 0.0
            clean = _marginal_logpdf(self.body, e, np.flatnonzero(~hit))
            dirty = _marginal_logpdf(self.outliers, e, np.flatnonzero(hit))
            total = np.logaddexp(total, weight + clean + dirty)
        return total

    def marginal(self, rows: Array) -> Contaminated:
        """The law of some components, where body and outliers have one: their coins stay as they are."""
        body, outliers = self.body.marginal(rows), self.outliers.marginal(rows)
        return Contaminated(self.rate, body, outliers, self.joint)


def _marginal_logpdf(law: Any, e: Array, rows: Array) -> Array | float:
    if not len(rows):
        return 0.0
    part: Law = law.marginal(rows)
    return part.logpdf(e[rows])
