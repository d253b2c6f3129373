"""Laplace noise of d dimensions in its two usual meanings: as a Gaussian scale mixture and with independent components.

mixture:      e = sqrt(W) L g,  g ~ N(0, I), one W ~ Exp(mean 1) a vector: the components share their tails.
independent:  e = C^(1/2) l,    l_i = sqrt(W_i) g_i iid Laplace of variance 1, C^(1/2) the symmetric root.

Both have covariance C (E W = 1). In one dimension they are the Laplace law of scale b = sqrt(C/2), whose variance is 2
b^2.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rkfbench.linalg import Array, dot, mul, whitening
from rkfbench.noise.base import Sample
from rkfbench.noise.matrices import factor, symmetric_root
from rkfbench.streams import Streams


@dataclass(frozen=True, eq=False)
class LaplaceMixture:
    """sqrt(W) L g with one W ~ Exp(1) a vector; C = L L'."""

    C: Array

    @property
    def dim(self) -> int:
        return len(self.C)

    @property
    def cov(self) -> Array:
        return self.C

    @property
    def parts(self) -> Mapping[str, Array]:
        return {}

    def sample(self, draw: Streams, steps: int) -> Sample:
        g = draw.normal("normal", steps, self.dim)
        W = draw.exponential("scale", steps)
        return Sample(np.sqrt(W)[:, None] * (factor(self.C) @ g), lambda: self.C[None, ..., None] * W[:, None, None])

    def logpdf(self, e: Array) -> Array:
        """log of 2 (2 pi)^(-d/2) |C|^(-1/2) (q/2)^(nu/2) K_nu(sqrt(2 q)), q = e' C^-1 e, nu = 1 - d/2 (K the modified
        Bessel function).
        """
        from scipy.special import kve

        L, inverse = whitening(self.C, "cholesky")
        z = mul(inverse, e)
        q = dot(z, z)
        nu = 1 - self.dim / 2
        r = np.sqrt(2 * q)
        with np.errstate(divide="ignore", invalid="ignore"):
            tail = 0.5 * nu * np.log(q / 2) + np.log(kve(nu, r)) - r
        if self.dim == 1:
            tail = np.where(q == 0, 0.5 * np.log(np.pi / 4), tail)
        return np.log(2) - 0.5 * self.dim * np.log(2 * np.pi) - np.log(np.diag(L)).sum() + tail

    def marginal(self, rows: Array) -> LaplaceMixture:
        """The law of some components: the family is closed."""
        return LaplaceMixture(self.C[np.ix_(rows, rows)])


@dataclass(frozen=True, eq=False)
class LaplaceIndependent:
    """C^(1/2) l with iid Laplace l_i of variance 1 and the symmetric root of C."""

    C: Array

    @property
    def dim(self) -> int:
        return len(self.C)

    @property
    def cov(self) -> Array:
        return self.C

    @property
    def parts(self) -> Mapping[str, Array]:
        return {}

    @property
    def root(self) -> Array:
        return symmetric_root(self.C)

    def sample(self, draw: Streams, steps: int) -> Sample:
        g = draw.normal("normal", steps, self.dim)
        W = draw.exponential("scale", steps, self.dim)
        A = self.root
        return Sample(A @ (np.sqrt(W) * g), lambda: np.einsum("ij,tjm,kj->tikm", A, W, A))

    def logpdf(self, e: Array) -> Array:
        """sum_i log exp(-sqrt 2 |l_i|)/sqrt 2 - log|C|/2, l = C^(-1/2) e."""
        l = mul(np.linalg.inv(self.root), e)  # noqa: E741
        return -np.sqrt(2) * np.abs(l).sum(0) - 0.5 * self.dim * np.log(2) - 0.5 * np.linalg.slogdet(self.C)[1]

    def marginal(self, rows: Array) -> LaplaceIndependent:
        """The law of some components; only a diagonal C keeps the family closed."""
        if np.count_nonzero(self.C - np.diag(np.diag(self.C))):
            raise ValueError("the marginal law of correlated independent-component Laplace noise has no closed form")
        return LaplaceIndependent(self.C[np.ix_(rows, rows)])
