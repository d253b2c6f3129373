"""Statistics over the runs, each with its leave-one-out replicates, so that any formula of them has a standard error.

A *replicate array* has shape (M + 1,): first the statistic of all M runs, then the statistic without run i for each i.
Arithmetic on such arrays is arithmetic on the statistics: `a - b`, `a / b`, `w * a` of replicate arrays are again
replicate arrays, and the jackknife

    se^2 = (M - 1)/M sum_i (theta_(-i) - mean theta_(-.))^2

of the outcome holds the covariance of everything that was measured on the same runs. For a mean it is s / sqrt(M).
The jackknife fails for the median; its replicates are made from the Bahadur representation instead (see `median`).

Sums are `math.fsum`, which rounds once: results do not depend on the order of the runs, and equal values have se 0.
"""

from __future__ import annotations

from math import fsum, sqrt
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TAIL = 0.025  # probability that a rank interval leaves out on either side


def mean(x: Array) -> Array:
    """The mean of x (M,) and its replicates; without run i it is m - (x_i - m)/(M - 1)."""
    m = _mean(x)
    return _replicates(m, m - (x - m) / (x.size - 1) if x.size > 1 else x * np.nan)


def rms(x: Array) -> Array:
    """The root of the mean square over runs: `pooled` error when x is a root mean square per run."""
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt(mean(x * x)))


def variance(x: Array) -> Array:
    """The sample variance (divisor M - 1); without run i it is ((M-1) s^2 - M/(M-1) (x_i - m)^2)/(M - 2)."""
    n = x.size
    if n < 2:
        return _replicates(np.nan, x * np.nan)
    with np.errstate(over="ignore"):
        squares = (x - _mean(x)) ** 2
    total = _sum(squares)
    without = (total - squares * n / (n - 1)) / (n - 2) if n > 2 else x * np.nan
    return _replicates(total / (n - 1), np.maximum(without, 0.0))


def sd(x: Array) -> Array:
    """The sample standard deviation (divisor M - 1)."""
    return np.asarray(np.sqrt(variance(x)))


def median(x: Array) -> Array:
    """The median; x may hold +inf (lost and failed runs). Replicates from theta_hat - theta = mean psi_i,
    psi_i = sign(x_i - theta) w, with w from the width between two order statistics (Price and Bonett 2001,
    J. Statist. Comput. Simul. 68, 295-305). Differences of medians measured on the same runs get their covariance
    from the products of the signs.
    """
    n = x.size
    middle = _middle(x)
    if n < 2 or not np.isfinite(middle):
        return _replicates(middle, x * np.nan)
    ordered = np.sort(x)
    c = max(round((n + 1) / 2 - sqrt(n)), 1)
    tail = 2 * _binomial_below(c, n)
    if not np.isfinite(ordered[n - c]):
        return _replicates(middle, x * np.nan)
    se = (ordered[n - c] - ordered[c - 1]) / (2 * NormalDist().inv_cdf(1 - tail / 2))
    return _replicates(middle, middle - np.sign(x - middle) * se / sqrt(n - 1))


def rank_interval(x: Array) -> tuple[float, float]:
    """The order statistics x_(c) and x_(n+1-c) with the median between them but for probability TAIL on either side,

        c the largest number with P(X < c) <= TAIL, X ~ Binomial(n, 1/2),

    whatever the law of x (which may hold +inf); NaN where the runs are too few.
    """
    n = x.size
    c = round((n + 1) / 2 + NormalDist().inv_cdf(TAIL) * sqrt(n) / 2) + 1  # the normal approximation, from above
    while c > 0 and _binomial_below(c, n) > TAIL:
        c -= 1
    if c < 1:
        return float("nan"), float("nan")
    ordered = np.sort(x)
    return float(ordered[c - 1]), float(ordered[n - c])


def _middle(x: Array) -> float:
    return float(np.median(x)) if x.size else float("nan")


STATISTICS = {"mean": mean, "median": median, "sd": sd, "variance": variance, "rms": rms}
VALUES = {"mean": lambda x: np.array([_mean(x)]), "median": lambda x: np.array([_middle(x)])}  # without replicates


def standard_error(replicates: Array) -> float:
    """The jackknife standard error of a replicate array (M + 1,); NaN for a single run."""
    without = np.asarray(replicates[1:])
    n = without.size
    if n < 2 or not np.isfinite(without).all():
        return float("nan")
    with np.errstate(over="ignore"):
        squares = (without - _mean(without)) ** 2
    return sqrt(_sum(squares) * (n - 1) / n)


def _mean(x: Array) -> float:
    """The mean, exact for equal values and independent of their order."""
    if not x.size or not np.isfinite(x).all():
        return float("nan")
    low = float(x.min())
    return low + _sum(x - low) / x.size


def _sum(x: Array) -> float:
    """The sum, rounded once; inf where it overflows."""
    try:
        return fsum(x)
    except OverflowError:
        return float("inf")


def _replicates(value: float, without: Array) -> Array:
    return np.concatenate(([value], without))


def _binomial_below(c: int, n: int) -> float:
    """P(X < c) for X ~ Binomial(n, 1/2), by the regularised incomplete beta function."""
    from scipy.special import bdtr

    return float(bdtr(c - 1, n, 0.5))
