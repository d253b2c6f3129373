"""The Gaussian filters for nonlinear models, by name: choices of moments and update scheme."""

from __future__ import annotations

from typing import Annotated, Literal

from annotated_types import Ge, Gt

from rkfbench.filters.baselines import BayesGrid, Zero
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import LineariseAt, Taylor
from rkfbench.filters.schemes import Iterated, Progressive, Step
from rkfbench.filters.sigma import Cubature, DividedDifference, Redraw, Unscented


def ekf(linearise_at: LineariseAt = "posterior") -> GaussianFilter:
    """Extended Kalman filter: x- = f(x), P- = F P F' + Q; S = H P- H' + R, K = P- H' S^-1, x = x- + K (y - h(x-)), P =
    P- - K S K'.
    """
    return GaussianFilter(moments=Taylor(linearise_at))


def ukf(
    alpha: Annotated[float, Gt(0), "spread of the points"] = 1.0,
    beta: Annotated[float, "weight of the centre in covariances"] = 0.0,
    kappa: Annotated[float | Literal["3-n"], "second spread, n + kappa > 0"] = "3-n",
    redraw: Redraw = True,
) -> GaussianFilter:
    """Unscented Kalman filter: Gaussian filter with unscented moments, alpha^2 (n + kappa) = h^2."""
    return GaussianFilter(moments=Unscented(redraw, alpha, beta, kappa))


def ckf(redraw: Redraw = True) -> GaussianFilter:
    """Cubature Kalman filter: Gaussian filter with moments from 2n points x +- sqrt(n) l_i."""
    return GaussianFilter(moments=Cubature(redraw))


def ddf(h2: Annotated[float, Gt(1), "square of the interval length"] = 3.0, redraw: Redraw = True) -> GaussianFilter:
    """Divided-difference filter of second order (DD2)."""
    return GaussianFilter(moments=DividedDifference(redraw, h2))


def iekf(
    iterations: Annotated[int, Ge(1), "number of re-linearisations"] = 10, linearise_at: LineariseAt = "posterior"
) -> GaussianFilter:
    """Iterated extended Kalman filter: plain Gauss-Newton on the posterior mode, then the EKF's covariance there."""
    return GaussianFilter(moments=Taylor(linearise_at), update=Iterated(iterations))


def pekf(dl: Step = 0.1, linearise_at: LineariseAt = "posterior") -> GaussianFilter:
    """Progressive extended Kalman filter, as printed: 1/dl sub-steps x + dl K nu, P - dl K H P with K = P H' (H P H' +
    R)^-1.
    """
    return GaussianFilter(moments=Taylor(linearise_at), update=Progressive(dl))


def zero() -> Zero:
    """The estimate 0 at all times: what a filter must beat to be of any use."""
    return Zero()


def bayes(points: Annotated[int, Ge(64), "grid points on the full circle"] = 8192) -> BayesGrid:
    """Bayes' rule on a grid of angles, for range and bearing of a fixed point with a range as good as known."""
    return BayesGrid(points)
