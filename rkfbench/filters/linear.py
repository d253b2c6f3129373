"""The linear filters of the ALADKF paper, by name: choices of parts of the Gaussian family, and the clairvoyant
reference.
"""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Gt

from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.filters.references import Clairvoyant
from rkfbench.filters.weights import Huber, LeastAbsolute

Threshold = Annotated[float, Gt(0), "Huber threshold beta of (11), in units of the whitened residual"]
Root = Annotated[Literal["symmetric", "cholesky"], "which root of R whitens the innovation"]


def kf(
    reuse_gains: Annotated[bool, "compute gains once for all runs, not in every step; the same estimates"] = True,
) -> GaussianFilter:
    """Kalman filter: x- = F x, P- = F P F' + Q; S = H P- H' + R, K = P- H' S^-1, x = x- + K nu, P = P- - K S K'."""
    return GaussianFilter(moments=Linear(), reuse_gains=reuse_gains)


def hkf(threshold: Threshold = 1.345, root: Root = "symmetric", reuse_root: bool = True) -> GaussianFilter:
    """Huber Kalman filter: the KF with R -> L diag(max(1, |e_i|/beta)) L', e = L^-1 nu, L L' = R; one pass."""
    return GaussianFilter(moments=Linear(), weight=Huber(threshold, root, reuse_root))


def aladkf() -> GaussianFilter:
    """Approximate least absolute deviation Kalman filter: the KF with R -> lambda R, lambda = sqrt(nu' R^-1 nu)."""
    return GaussianFilter(moments=Linear(), weight=LeastAbsolute())


def clairvoyant_kf() -> Clairvoyant:
    """Clairvoyant Kalman filter: knows the coin, label and scale of every noise value; a true lower bound of the mean
    square error.
    """
    return Clairvoyant()
