"""What a noise law is: it knows its covariance, samples from the primitives of a stream, remembers how, and has a
density.

Every law here is a Gaussian scale mixture: given the hidden record of a draw (coin, label, scale) the value is
Gaussian with a known mean and covariance. A `Sample` keeps that record, so that a clairvoyant filter can be told what
no real filter knows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rkfbench.linalg import Array, dot, mul, whitening
from rkfbench.streams import Streams


@dataclass(frozen=True)
class Sample:
    """Noise of T steps and M runs: value (T, d, M).

    `flags`, (T, M) or (T, d, M), say which values are outliers (None: the law has none). Given the record behind the
    draw, the value is Gaussian with mean `mean` (broadcasting against value) and covariance `cov()`, (T or 1, d, d, M
    or 1).
    """

    value: Array
    cov: Callable[[], Array]
    mean: Array | float = 0.0
    flags: np.ndarray | None = None

    def of(self, runs: slice, steps: int | None = None) -> Sample:
        """The same noise of some of the runs, in the first steps."""

        def cut(a: Array) -> Array:  # what is 1 wide or long holds for all runs or steps
            a = a if a.shape[-1] == 1 else a[..., runs]
            return a if len(a) == 1 else a[:steps]

        mean = self.mean if np.ndim(self.mean) == 0 else cut(np.asarray(self.mean))
        return Sample(cut(self.value), lambda: cut(self.cov()), mean, None if self.flags is None else cut(self.flags))

    def __add__(self, other: Sample) -> Sample:
        """The sum with independent noise; a value is an outlier where either part says so."""
        flags = (
            self.flags
            if other.flags is None
            else other.flags
            if self.flags is None
            else _either(self.flags, other.flags)
        )
        return Sample(self.value + other.value, lambda: self.cov() + other.cov(), self.mean + other.mean, flags)


def _either(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Flags by vector (T, M) and by component (T, d, M) meet by component."""
    if a.ndim != b.ndim:
        a, b = (flags[:, None] if flags.ndim == 2 else flags for flags in (a, b))
    return a | b


class Law(Protocol):
    """A distribution of d-dimensional noise, independent over time."""

    @property
    def dim(self) -> int: ...

    @property
    def cov(self) -> Array:
        """Covariance (d, d)."""
        ...

    @property
    def parts(self) -> Mapping[str, Array]:
        """Covariances that the law can name, e.g. `body`; what filters are told may be one of them."""
        ...

    def sample(self, draw: Streams, steps: int) -> Sample:
        """Noise of `steps` steps for the runs of the stream."""
        ...

    def logpdf(self, e: Array) -> Array:
        """Log density at e (d, ...)."""
        ...


def gaussian_logpdf(e: Array, C: Array) -> Array:
    """log N(e; 0, C) for e (d, ...) and one covariance C (d, d)."""
    L, inverse = whitening(C, "cholesky")
    z = mul(inverse, e)
    density = dot(z, z)
    density *= -0.5
    density -= np.log(np.diag(L)).sum() + 0.5 * len(C) * np.log(2 * np.pi)
    return density
