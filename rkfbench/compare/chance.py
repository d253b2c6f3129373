"""How surprising a difference would be if it were chance alone, each as the z of a normal law that is as unlikely.

So one threshold serves all tests of a family, whatever their laws. The sign is that of first minus second; 0 says that
there is nothing to tell, infinite that chance has no part in it. Under the hypothesis both are samples of one law.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import copysign, inf, sqrt
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

ROUNDING = 1e-9  # relative
QUANTILES = (("q05", 0.05), ("median", 0.5), ("q95", 0.95))


class Sample(NamedTuple):
    """What is known of a sample without its values: how many, their mean and standard deviation."""

    n: Any
    mean: Any
    sd: Any


class Skew(NamedTuple):
    """The largest skewness that the law of the samples may have, to the right and, as a positive number, to the
    left.
    """

    right: Any
    left: Any


def threshold(tests: int, error: float) -> float:
    """The Bonferroni value: |z| exceeds it in any of the tests with no more than the probability `error`."""
    return NormalDist().inv_cdf(1 - error / 2 / tests) if tests else inf


def paired(x: Array, y: Array) -> float:
    """t of the mean of M paired differences x - y, M - 1 degrees of freedom.

    Where chance alone makes them, either of a pair may be the larger: a symmetric law, for which t is never too large
    by much, however heavy its tails are (Efron 1969, J. Amer. Statist. Assoc. 64, 1278-1302). Where all differences
    are equal, as those of shares of few runs may be by chance, their sign is all that they tell.
    """
    difference = x - y
    M, mean = len(x), float(difference.mean())
    if M < 2 or mean == 0:
        return 0.0
    if _one_value(difference):
        return signs(*((M, 0) if mean > 0 else (0, M)))
    return float(_of_t(mean / (float(difference.std(ddof=1)) / sqrt(M)), M - 1))


def means(first: Sample, second: Sample, skew: Skew) -> Array:
    """t of the difference of two means with the pooled variance, n1 + n2 - 2 degrees of freedom; arrays broadcast.

    Pooled, so a mean of equal values in few runs (no outlier in 100 of them) does not pass for a number without chance.
    The smaller sample brings the skewness g of the law into the difference of the means, of which it is then

        g (1/n1^2 - 1/n2^2)/(1/n1 + 1/n2)^1.5;

    z is taken from a gamma law of this skewness (Wilson and Hilferty 1931) where its tail is the heavier one. Where
    neither sample varies, chance could only have dealt n values of one kind to the one and m of another to the other.
    """
    (n, a, _), (m, b, _) = first, second
    difference, df = np.subtract(a, b), np.add(n, m) - 2
    with np.errstate(all="ignore"):
        spread = np.sqrt(pooled_variance(first, second) * (1 / np.asarray(n) + 1 / np.asarray(m)))
        dealt = np.vectorize(lambda n, m: shares(int(n), int(n), 0, int(m)), otypes=[float])
        z = np.where(spread > 0, _of_t(difference / spread, np.maximum(df, 1)), 0.0)
        if (still := (spread == 0) & (difference != 0)).any():
            z = np.where(still, np.copysign(dealt(n, m), difference), z)
        lean = (1 / np.square(n, dtype=float) - 1 / np.square(m, dtype=float)) / (
            1 / np.asarray(n) + 1 / np.asarray(m)
        ) ** 1.5
        g = np.abs(lean) * np.where(difference * lean > 0, skew.right, skew.left)
        size = np.abs(z)
        straight = 6 / g * (np.cbrt(1 + g * size / 2) - 1) + g / 6
        z = np.copysign(np.where(g > 0, np.minimum(size, straight), size), difference)
    return np.where((difference == 0) | (df < 1), 0.0, z)


def pooled_variance(first: Sample, second: Sample) -> Array:
    """((n1 - 1) s1^2 + (n2 - 1) s2^2)/(n1 + n2 - 2)."""
    (n, _, s), (m, _, r) = first, second
    with np.errstate(all="ignore"):
        return np.asarray(
            ((np.asarray(n) - 1) * np.square(s) + (np.asarray(m) - 1) * np.square(r)) / (np.add(n, m) - 2)
        )


def signs(up: int, down: int) -> float:
    """The sign test, and McNemar's: which of the two is larger in `up` and in `down` pairs is a toss of a coin."""
    from scipy.special import bdtrc

    return _signed(float(bdtrc(max(up, down) - 1, up + down, 0.5)), up - down) if up != down else 0.0


def beside_median(above: int, below: int, n: int, m: int) -> float:
    """Of n values `above` lie above, `below` below the median of m others (Mathisen 1943, Ann. Math. Statist. 14).

    How many do is beta-binomial with both parameters (m + 1)/2, whatever the law of the values. Ties speak for chance.
    """
    more = max(above, below)
    return _signed(_beta_binomial(more, n, (m + 1) / 2), above - below) if 2 * more > n else 0.0


def shares(k: int, n: int, j: int, m: int) -> float:
    """k of n and j of m: Fisher's exact test, the hypergeometric law of k given k + j."""
    if k * m == j * n:
        return 0.0
    p = _hypergeometric(k, n, j, m) if k * m > j * n else _hypergeometric(n - k, n, m - j, m)
    return _signed(p, k * m - j * n)


def quantiles(first: Mapping[str, Any], second: Mapping[str, Any]) -> float:
    """How far the laws of two summaries must lie apart, whatever they are: where the p quantile of one lies below the
    q quantile of the other and q < p, p - q as a difference of shares of runs.

    Coarse, but neither two humps nor few distinct values nor infinite ones deceive it.
    """
    return max(_crossed(second, first), -_crossed(first, second), key=abs)


def _crossed(low: Mapping[str, Any], high: Mapping[str, Any]) -> float:
    """How far the quantiles of `high` lie above those of `low`."""
    found = [
        (p - q) / sqrt(p * (1 - p) / low["runs"] + q * (1 - q) / high["runs"])
        for name, p in QUANTILES
        for other, q in QUANTILES
        if q < p and high[other] > low[name]
    ]
    return max(found, default=0.0)


def _one_value(x: Array) -> bool:
    """Whether all are the same but for rounding."""
    return bool(np.ptp(x) <= ROUNDING * np.abs(x).max())


def _of_t(t: Any, df: Any) -> Array:
    """The z that is as unlikely as t."""
    from scipy.special import ndtri, stdtr

    return np.asarray(np.copysign(-ndtri(stdtr(df, -np.abs(t))), t))


def _signed(p: float, sign: float) -> float:
    """The z of a one-sided probability."""
    from scipy.special import ndtri

    return copysign(max(0.0, -float(ndtri(min(p, 1.0)))), sign)


@lru_cache(maxsize=4096)
def _beta_binomial(k: int, n: int, a: float) -> float:
    """P(K >= k) of K ~ Binomial(n, U), U ~ Beta(a, a)."""
    from scipy.special import betaln, gammaln

    i = np.arange(k, n + 1)
    return float(np.exp(_log_choose(n, i, gammaln) + betaln(i + a, n - i + a) - betaln(a, a)).sum())


@lru_cache(maxsize=4096)
def _hypergeometric(k: int, n: int, j: int, m: int) -> float:
    """P(K >= k) of the number K among the n when k + j of all n + m are drawn."""
    from scipy.special import gammaln

    total, i = k + j, np.arange(k, min(n, k + j) + 1)
    logs = _log_choose(n, i, gammaln) + _log_choose(m, total - i, gammaln) - _log_choose(n + m, total, gammaln)
    return float(np.exp(logs).sum())


def _log_choose(n: Any, k: Any, gammaln: Any) -> Any:
    return gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)
