"""The maximum correntropy weight: each component of the innovation counts by a Gaussian kernel of its size.

Eqs (2), (6) and (16) of the FP-MCS paper: C = diag(c), c_i = exp(-nu_i^2 / (2 sigma^2 R_ii)), and the gain P H' C (R +
S C)^-1. Computed once a step, from the
prior innovation. Nothing is divided by c, which underflows to exactly 0 beyond 38.6 sigma sqrt(R_ii): that measurement
component is then ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Gt, Interval

from rkfbench.filters.weights import Weighted
from rkfbench.linalg import Array, batched

Sigma = Annotated[float, Gt(0), "kernel width, in units of the square root of R_ii; inf: no weight at all"]
Kernel = Annotated[
    Literal["squared", "abs", "innovation_cov"],
    "exp(-nu^2/(2 sigma^2 R)) of (2), exp(-|nu|/(2 sigma^2 sqrt R)) as section 2.3 prints it, "
    "or squared with S + R in the place of R (ours)",
]
Floor = Annotated[float, Interval(ge=0, lt=1), "smallest weight (ours); 0: none"]


@dataclass(frozen=True)
class Correntropy:
    """Correntropy weight by component: D = diag(sqrt(c)), R' = R, nu' = D nu.

    For a diagonal R this is R C^-1 in the place of R; for any other R it is the symmetric form D^-1 R D^-1 of it.
    """

    sigma: Sigma = 1.0
    kernel: Kernel = "squared"
    floor: Floor = 0.0

    sees: ClassVar[frozenset[str]] = frozenset({"weight"})

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        if np.isinf(self.sigma):
            return Weighted(R, nu, seen={"weight": np.ones_like(nu)})
        c = self.of(nu, R, Szz)
        D = np.sqrt(c)
        return Weighted(R, D * nu, D, {"weight": c})

    def of(self, nu: Array, R: Array, Szz: Array) -> Array:
        """The weights c (m, M) of an innovation nu (m, M) whose prediction has the covariance Szz."""
        scale = np.einsum("ii...->i...", batched(R))
        if self.kernel == "innovation_cov":
            scale = scale + np.einsum("ii...->i...", Szz)
        size = np.abs(nu) / np.sqrt(scale) if self.kernel == "abs" else nu * nu / scale
        c = np.exp(-size / (2 * self.sigma**2))
        return np.maximum(c, self.floor) if self.floor else c
