"""What chance must explain: every row and curve that differs between two folders, each with its z.

Which test is made of what stands at the head of `rkfbench.compare`; `chance` has the tests.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench import metrics
from rkfbench.compare import chance
from rkfbench.compare.chance import Sample, Skew
from rkfbench.compare.pair import Array, Difference, Key, Pair, undefined
from rkfbench.errors import SpecError
from rkfbench.metrics import Metric
from rkfbench.store.results import Results, Row


@dataclass(frozen=True)
class Curve:
    """The tests of the steps of one curve: how many, and the one that tells most."""

    tests: int
    worst: Difference | None


def counts(pair: Pair) -> Iterator[Difference]:
    """Failed and lost runs of each filter in each case; a case without any has nothing to test."""
    groups = {key[:3]: key for key in pair.rows}
    for what, read in (("failed", Results.failed), ("lost", Results.lost)):
        for group, key in groups.items():
            first, second = pair.first[key], pair.second[key]
            if not (first[what] or second[what]):  # a failed run counts as lost only where there is such a thing
                continue
            if pair.paired:
                x, y = _together(read(pair.a, *group), read(pair.b, *group))
                z, tested = chance.signs(int((x & ~y).sum()), int((y & ~x).sum())), bool((x != y).any())
            else:
                k, n, j, m = first[what], first["runs"], second[what], second["runs"]
                z, tested = chance.shares(k, n, j, m), k + j not in (0, n + m)
            if tested:
                a, b = (row[what] / row["runs"] for row in (first, second))
                yield Difference((*group, what), "share", a, b, z)


def summaries(pair: Pair) -> Iterator[Difference]:
    """Mean, middle and infinite values of the rows that do not agree."""
    apart = [key for key in pair.rows if not pair.same_row(pair.first[key], pair.second[key])]
    if pair.paired:
        for key in apart:
            yield from _paired(pair, key, pair.first[key], pair.second[key])
    else:
        yield from _means(pair, apart)
        for key in apart:
            yield from _middles(pair, key, pair.first[key], pair.second[key])


def _paired(pair: Pair, key: Key, first: Row, second: Row) -> Iterator[Difference]:
    """The tests of a row on the pairs of its runs."""
    x, y = _together(pair.a.values(*key), pair.b.values(*key))
    differ = ~pair.alike(x, y)
    finite = np.isfinite(x) & np.isfinite(y)
    if not finite.any():
        yield from _vanished(key, first, second)
    elif (differ & finite).any():
        with np.errstate(over="ignore", invalid="ignore"):
            z = chance.paired(x[finite], y[finite])
        yield Difference(key, "mean", first["mean"], second["mean"], z)
    if (infinite := np.isinf(x) != np.isinf(y)).any():
        up, down = int((infinite & np.isinf(x)).sum()), int((infinite & np.isinf(y)).sum())
        yield Difference(key, "infinite", up / len(x), down / len(x), chance.signs(up, down))
    up, down = int((differ & (x > y)).sum()), int((differ & (x < y)).sum())
    if up + down:
        yield Difference(key, "median", first["median"], second["median"], chance.signs(up, down))


def _means(pair: Pair, keys: Iterable[Key]) -> Iterator[Difference]:
    """The means of rows whose runs have nothing to do with each other, or are not kept; all rows at once."""
    tested = []
    for key in keys:
        first, second = pair.first[key], pair.second[key]
        a, b = first["mean"], second["mean"]
        if undefined(a) or undefined(b):
            yield from _vanished(key, first, second)
        elif not pair.equal(a, b) and all(map(math.isfinite, (a, b, first["sd"] or 0, second["sd"] or 0))):
            tested.append(key)
    if tested:
        roots = [_is_root(key) for key in tested]
        rows = [[each[key] for key in tested] for each in (pair.first, pair.second)]
        x, y = (Sample(*np.array(list(map(_sample, side, roots))).T) for side in rows)
        skew = _skew(x, y, *(_reach(side, roots) for side in rows))
        for key, z in zip(tested, chance.means(x, y, skew).tolist(), strict=True):
            yield Difference(key, "mean", pair.first[key]["mean"], pair.second[key]["mean"], z)


def _middles(pair: Pair, key: Key, first: Row, second: Row) -> Iterator[Difference]:
    """The infinite values and the median of such a row."""
    if pair.a.has_runs and pair.b.has_runs:
        x, y = pair.a.values(*key), pair.b.values(*key)
        k, j = int(np.isinf(x).sum()), int(np.isinf(y).sum())
        if k + j:
            yield Difference(key, "infinite", k / len(x), j / len(y), chance.shares(k, len(x), j, len(y)))
    a, b = first["median"], second["median"]
    if not (pair.equal(a, b) or undefined(a) or undefined(b)):
        yield Difference(key, "median", a, b, _middle(pair, key, first, second))


def _middle(pair: Pair, key: Key, first: Row, second: Row) -> float:
    """The runs of one folder beside the median of the other, or the quantiles of both."""
    if pair.a.has_runs:
        return _beside(pair, _sampled(pair.a, key), second)
    if pair.b.has_runs:
        return -_beside(pair, _sampled(pair.b, key), first)
    return chance.quantiles(first, second)


def _beside(pair: Pair, x: Array, row: Row) -> float:
    differ = ~pair.alike(x, row["median"])
    above, below = int((differ & (x > row["median"])).sum()), int((differ & (x < row["median"])).sum())
    return chance.beside_median(above, below, len(x), _numbers(row) + row["failed"])


def _vanished(key: Key, first: Row, second: Row) -> Iterator[Difference]:
    """Where one folder has no number at all: whether it could have had some, as shares of runs."""
    a, b = first["mean"], second["mean"]
    if undefined(a) != undefined(b):
        z = chance.shares(_numbers(first), first["runs"], _numbers(second), second["runs"])
        yield Difference(key, "mean", a, b, z)


def curves(pair: Pair) -> Iterator[Curve]:
    """The means of the steps of each curve. A law of which mean m and standard deviation s are all that is known is
    taken to be as skew as a lognormal one, 3c + c^3 with c = s/|m|.
    """
    sound = [{key[:3]: row["runs"] - row["failed"] for key, row in rows.items()} for rows in (pair.first, pair.second)]
    for key in pair.series[0]:
        if key in pair.series[1]:
            n, m = (runs.get(key[:3], each.runs) for runs, each in zip(sound, (pair.a, pair.b), strict=True))
            yield _curve(pair, key, n, m)


def _curve(pair: Pair, key: Key, n: int, m: int) -> Curve:
    """The curve over n runs in one folder and over m in the other."""
    x, y = _common_steps(pair.series[0][key], pair.series[1][key])
    root = _is_root(key)
    first, second = (
        _of_squares(Sample(runs, each[:, 1], each[:, 2] * math.sqrt(runs)), root) for runs, each in ((n, x), (m, y))
    )
    with np.errstate(all="ignore"):
        tested = ~pair.alike(x[:, 1], y[:, 1]) & np.isfinite(x[:, 1:3]).all(1) & np.isfinite(y[:, 1:3]).all(1)
        mean = (n * first.mean + m * second.mean) / (n + m)
        c = np.sqrt(chance.pooled_variance(first, second)) / np.abs(mean)
        skew = np.minimum(3 * c + c**3, math.sqrt(n + m))
        z = np.where(tested, chance.means(first, second, Skew(skew, skew)), 0.0)
    if not tested.any():
        return Curve(0, None)
    i = int(np.argmax(np.abs(z)))
    return Curve(int(tested.sum()), Difference(key, f"k = {x[i, 0]:g}", float(x[i, 1]), float(y[i, 1]), float(z[i])))


def _common_steps(x: Array, y: Array) -> tuple[Array, Array]:
    """The steps that both curves have."""
    return x[np.isin(x[:, 0], y[:, 0])], y[np.isin(y[:, 0], x[:, 0])]


def _together(x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The runs that both have: the first ones."""
    runs = min(len(x), len(y))
    return x[:runs], y[:runs]


def _metric(name: str) -> Metric | None:
    """The metric of that name; None for one of a plug-in that is not here: its statistic is a mean over all runs."""
    try:
        return metrics.get(name)
    except SpecError:
        return None


def _is_root(key: Key) -> bool:
    metric = _metric(key[3])
    return metric is not None and metric.root


def _sampled(results: Results, key: Key) -> Array:
    """The values of which summary.csv gives the quantiles."""
    metric = _metric(key[3])
    values = np.where(results.failed(*key[:3]), np.inf, results.values(*key))
    if metric is not None and metric.tracking:
        values = values[~results.lost(*key[:3])]
    values = values[~np.isnan(values)]
    return np.sqrt(values) if _is_root(key) else values


def _numbers(row: Row) -> int:
    """In how many runs the row has a number: (sd/se)^2; in one where there is no sd, in all sound ones where sd = 0."""
    if undefined(row["mean"]):
        return 0
    if row["sd"] is None:
        return 1
    return (
        round((row["sd"] / row["se"]) ** 2) if row["se"] and math.isfinite(row["sd"]) else row["runs"] - row["failed"]
    )


def _sample(row: Row, root: bool) -> Sample:
    return _of_squares(Sample(_numbers(row), row["mean"], row["sd"] or 0.0), root)


def _of_squares(sample: Sample, root: bool) -> Sample:
    """The root of a mean is tested as the mean: the standard deviation s of r by the delta method is 2 r s of r^2."""
    return Sample(sample.n, sample.mean**2, 2 * sample.mean * sample.sd) if root else sample


def _reach(rows: Sequence[Row], roots: Sequence[bool]) -> Array:
    """The largest value of each row and its 5 % quantile, (2, rows)."""
    found = np.array([[row["max"] for row in rows], [row["q05"] for row in rows]], dtype=float)
    return np.where(roots, found**2, found)


def _skew(first: Sample, second: Sample, reach: Array, other: Array) -> Skew:
    """The third moment of a law is at most its variance times its reach, so its skewness at most the reach in standard
    deviations. To the right that is the largest value, to the left, of which summary.csv does not tell, three times
    the way to the 5 % quantile. Where runs failed their values tell nothing, but no sample of N values is more skew
    than sqrt(N).
    """
    N = first.n + second.n
    with np.errstate(all="ignore"):
        mean, sd = (first.n * first.mean + second.n * second.mean) / N, np.sqrt(chance.pooled_variance(first, second))
        ways = np.maximum(reach[0], other[0]) - mean, 3 * (mean - np.minimum(reach[1], other[1]))
        right, left = (np.fmin(way / sd, np.sqrt(N)) for way in ways)
    return Skew(np.where(np.isfinite(right), right, np.sqrt(N)), np.where(np.isfinite(left), left, np.sqrt(N)))
