"""Two results folders side by side: the same bytes, the same numbers to a tolerance, or a statistical difference.

The same to the tolerance are all cells of all tables, runs.csv apart. Else chance is asked, with one Bonferroni
threshold of a 95 % family for all tests that are made:

- runs that failed, and runs that were lost, of each filter in each case: McNemar's test where the runs are paired
  (both folders keep them, and the seeds agree), else Fisher's;
- the mean of each row of summary.csv: t of the paired differences, else t with the pooled variance, corrected for the
  skewness that the extremes of the row allow;
- its middle, which infinite values and heavy tails leave alone: the sign test of the pairs; else how many runs lie
  beside the other folder's median; where neither keeps its runs, whether quantiles of summary.csv have changed places;
- its infinite values, where both folders keep their runs, in the same way as runs that failed;
- the mean of each step of a curve in series.csv, pooled as above.

Runs that failed are in no pair of values; quantiles of summary.csv count them as +inf. Medians of curves and paths of
single runs are not tested. An exact check, which has no chance in it, differs when it crosses its own tolerance. Rows
that only one folder has are differences.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rkfbench import chance, metrics
from rkfbench.chance import Sample, Skew
from rkfbench.errors import SpecError
from rkfbench.metrics import Metric
from rkfbench.store import files
from rkfbench.store.results import RUNS, Results, Row

TOLERANCE = 1e-9  # relative: what another machine may change
FAMILY_ERROR = 0.05
TABLES = ("summary.csv", "series.csv", "filters.csv", "runs.csv", "checks.csv")
STATISTICS = ("runs", "failed", "lost", "mean", "se", "sd", "median", "q05", "q95", "max")
CURVES = ("k", "mean", "se", "median", "first")

Key = tuple[str, str, str, str]  # reading, case, filter, metric
Level = Literal["same bytes", "same to the tolerance", "no statistical difference", "different"]
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Difference:
    """What differs and by how much: a and b, and the z of a normal law that is as unlikely."""

    key: Key
    what: str  # row, mean, median, infinite, share, curve, k = 12, check
    a: float | None
    b: float | None
    z: float  # infinite where chance has no part in it, or a row is missing

    def swapped(self) -> Difference:
        """The same seen from the other side."""
        return Difference(self.key, self.what, self.b, self.a, -self.z)

    def as_row(self) -> Row:
        reading, case, filter, metric = self.key
        return {
            "reading": reading,
            "case": case,
            "filter": filter,
            "metric": metric,
            "what": self.what,
            "a": self.a,
            "b": self.b,
            "z": self.z,
        }


@dataclass(frozen=True)
class Comparison:
    """What two folders have in common: the level, the number of rows compared, and the differences that decide."""

    level: Level
    rows: int
    threshold: float = math.inf
    differences: list[Difference] = field(default_factory=list)


def compare(a: Results, b: Results, tolerance: float = TOLERANCE, common: bool = False) -> Comparison:
    """The strongest level on which two results agree; with `common`, what only one of them has does not count."""
    pair = _Pair(a, b, tolerance)
    if _same_bytes(a, b, common):
        return Comparison("same bytes", len(pair.first))
    certain = [*pair.crossed()] if common else [*pair.crossed(), *pair.alone()]
    if not certain and pair.close():
        return Comparison("same to the tolerance", len(pair.rows))
    tests = [*pair.counts(), *pair.summaries()]
    curves = [*pair.curves()]
    threshold = chance.threshold(len(tests) + sum(each.tests for each in curves), FAMILY_ERROR)
    tested = tests + [each.worst for each in curves if each.worst is not None]
    differences = certain + _largest(each for each in tested if abs(each.z) > threshold)
    level: Level = "different" if differences else "no statistical difference"
    return Comparison(level, len(pair.rows), threshold, differences)


@dataclass(frozen=True)
class _Curve:
    """The tests of the steps of one curve: how many, and the one that tells most."""

    tests: int
    worst: Difference | None


class _Pair:
    """Two folders with their rows by key."""

    def __init__(self, a: Results, b: Results, tolerance: float) -> None:
        self.a, self.b, self.tolerance = a, b, tolerance
        self.first, self.second = _rows(a), _rows(b)
        self.rows = [key for key in self.first if key in self.second]
        self.paired = a.seed == b.seed and a.has_runs and b.has_runs
        self._curves: tuple[dict[Key, Array], dict[Key, Array]] | None = None

    @property
    def series(self) -> tuple[dict[Key, Array], dict[Key, Array]]:
        """The curves of both, by key."""
        if self._curves is None:
            self._curves = _curves(self.a), _curves(self.b)
        return self._curves

    def alone(self) -> Iterator[Difference]:
        """What only one of them has: rows, curves and checks."""
        for side, (x, y) in enumerate(((self.a, self.b), (self.b, self.a))):
            rows, others = (self.first, self.second)[:: -1 if side else 1]
            found = [
                Difference(key, "row", row["mean"], None, math.inf) for key, row in rows.items() if key not in others
            ]
            mine, theirs = self.series[:: -1 if side else 1]
            found += [Difference(key, "curve", None, None, math.inf) for key in mine if key not in theirs]
            found += [
                Difference(_check(id), "check", x.check(id)[0], None, math.inf) for id in x.checks if id not in y.checks
            ]
            yield from (each.swapped() if side else each for each in found)

    def crossed(self) -> Iterator[Difference]:
        """Exact checks that one folder passes and the other does not."""
        for id in self.a.checks.keys() & self.b.checks.keys():
            (x, limit), (y, other) = self.a.check(id), self.b.check(id)
            if (x <= limit) != (y <= other):
                yield Difference(_check(id), "check", x, y, math.copysign(math.inf, x - y))

    def close(self) -> bool:
        """Whether all cells that both have agree to the tolerance."""
        return (
            all(self._close(self.first[key], self.second[key]) for key in self.rows)
            and self._same_filters()
            and self._same_checks()
            and self._same_curves()
        )

    def _close(self, first: Row, second: Row, columns: Iterable[str] = STATISTICS) -> bool:
        """Whether all statistics of a row agree; counts of runs, failed and lost must be equal."""
        return all(self.equal(first.get(column), second.get(column)) for column in columns)

    def _same_filters(self) -> bool:
        """Whether filters of the same label have the same parameters."""
        first, second = ({row["label"]: row for row in each.filters} for each in (self.a, self.b))
        return all(self._close(first[key], second[key], first[key] | second[key]) for key in first if key in second)

    def _same_checks(self) -> bool:
        """Whether checks deviate alike; what lies within its tolerance is rounding."""
        return all(
            self.equal(limit, self.b.checks[id][1])
            and math.isclose(x, self.b.checks[id][0], rel_tol=self.tolerance, abs_tol=limit)
            for id, (x, limit) in self.a.checks.items()
            if id in self.b.checks
        )

    def _same_curves(self) -> bool:
        first, second = self.series
        return all(
            first[key].shape == second[key].shape and bool(self.alike(first[key], second[key]).all())
            for key in first
            if key in second
        )

    def equal(self, x: Any, y: Any) -> bool:
        if _undefined(x) or _undefined(y):
            return _undefined(x) and _undefined(y)
        numbers = isinstance(x, int | float) and isinstance(y, int | float)
        return x == y or bool(numbers and math.isclose(x, y, rel_tol=self.tolerance))

    def alike(self, x: Array, y: Array | float) -> NDArray[np.bool_]:
        """Where numbers agree to the tolerance, or neither is one."""
        with np.errstate(invalid="ignore", over="ignore"):
            near = np.abs(x - y) <= self.tolerance * np.maximum(np.abs(x), np.abs(y))
        return (x == y) | (near & np.isfinite(x) & np.isfinite(y)) | (np.isnan(x) & np.isnan(y))

    def counts(self) -> Iterator[Difference]:
        """Failed and lost runs of each filter in each case; a case without any has nothing to test."""
        groups = {key[:3]: key for key in self.rows}
        for what, read in (("failed", Results.failed), ("lost", Results.lost)):
            for group, key in groups.items():
                first, second = self.first[key], self.second[key]
                if self.paired:
                    x, y = _together(read(self.a, *group), read(self.b, *group))
                    z, tested = chance.signs(int((x & ~y).sum()), int((y & ~x).sum())), bool((x != y).any())
                else:
                    k, n, j, m = first[what], first["runs"], second[what], second["runs"]
                    z, tested = chance.shares(k, n, j, m), k + j not in (0, n + m)
                if tested:
                    a, b = (row[what] / row["runs"] for row in (first, second))
                    yield Difference((*group, what), "share", a, b, z)

    def summaries(self) -> Iterator[Difference]:
        """Mean, middle and infinite values of the rows that do not agree."""
        apart = [key for key in self.rows if not self._close(self.first[key], self.second[key])]
        if self.paired:
            for key in apart:
                yield from self._paired(key, self.first[key], self.second[key])
        else:
            yield from self._means(apart)
            for key in apart:
                yield from self._middles(key, self.first[key], self.second[key])

    def _paired(self, key: Key, first: Row, second: Row) -> Iterator[Difference]:
        """The tests of a row on the pairs of its runs."""
        x, y = _together(self.a.values(*key), self.b.values(*key))
        differ = ~self.alike(x, y)
        finite = np.isfinite(x) & np.isfinite(y)
        if not finite.any():
            yield from self._vanished(key, first, second)
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

    def _means(self, keys: Iterable[Key]) -> Iterator[Difference]:
        """The means of rows whose runs have nothing to do with each other, or are not kept; all rows at once."""
        tested = []
        for key in keys:
            first, second = self.first[key], self.second[key]
            a, b = first["mean"], second["mean"]
            if _undefined(a) or _undefined(b):
                yield from self._vanished(key, first, second)
            elif not self.equal(a, b) and all(map(math.isfinite, (a, b, first["sd"] or 0, second["sd"] or 0))):
                tested.append(key)
        if tested:
            roots = [_is_root(key) for key in tested]
            rows = [[each[key] for key in tested] for each in (self.first, self.second)]
            x, y = (Sample(*np.array(list(map(_sample, side, roots))).T) for side in rows)
            skew = _skew(x, y, *(_reach(side, roots) for side in rows))
            for key, z in zip(tested, chance.means(x, y, skew).tolist(), strict=True):
                yield Difference(key, "mean", self.first[key]["mean"], self.second[key]["mean"], z)

    def _middles(self, key: Key, first: Row, second: Row) -> Iterator[Difference]:
        """The infinite values and the median of such a row."""
        if self.a.has_runs and self.b.has_runs:
            x, y = self.a.values(*key), self.b.values(*key)
            k, j = int(np.isinf(x).sum()), int(np.isinf(y).sum())
            if k + j:
                yield Difference(key, "infinite", k / len(x), j / len(y), chance.shares(k, len(x), j, len(y)))
        a, b = first["median"], second["median"]
        if not (self.equal(a, b) or _undefined(a) or _undefined(b)):
            yield Difference(key, "median", a, b, self._middle(key, first, second))

    def _middle(self, key: Key, first: Row, second: Row) -> float:
        """The runs of one folder beside the median of the other, or the quantiles of both."""
        if self.a.has_runs:
            return self._beside(_sampled(self.a, key), second)
        if self.b.has_runs:
            return -self._beside(_sampled(self.b, key), first)
        return chance.quantiles(first, second)

    def _beside(self, x: Array, row: Row) -> float:
        differ = ~self.alike(x, row["median"])
        above, below = int((differ & (x > row["median"])).sum()), int((differ & (x < row["median"])).sum())
        return chance.beside_median(above, below, len(x), _numbers(row) + row["failed"])

    def _vanished(self, key: Key, first: Row, second: Row) -> Iterator[Difference]:
        """Where one folder has no number at all: whether it could have had some, as shares of runs."""
        a, b = first["mean"], second["mean"]
        if _undefined(a) != _undefined(b):
            z = chance.shares(_numbers(first), first["runs"], _numbers(second), second["runs"])
            yield Difference(key, "mean", a, b, z)

    def curves(self) -> Iterator[_Curve]:
        """The means of the steps of each curve. A law of which mean m and standard deviation s are all that is known is
        taken to be as skew as a lognormal one, 3c + c^3 with c = s/|m|.
        """
        sound = [
            {key[:3]: row["runs"] - row["failed"] for key, row in rows.items()} for rows in (self.first, self.second)
        ]
        for key in self.series[0]:
            if key in self.series[1]:
                n, m = (runs.get(key[:3], each.runs) for runs, each in zip(sound, (self.a, self.b), strict=True))
                yield self._curve(key, n, m)

    def _curve(self, key: Key, n: int, m: int) -> _Curve:
        """The curve over n runs in one folder and over m in the other."""
        x, y = _common_steps(self.series[0][key], self.series[1][key])
        root = _is_root(key)
        first, second = (
            _of_squares(Sample(runs, each[:, 1], each[:, 2] * math.sqrt(runs)), root) for runs, each in ((n, x), (m, y))
        )
        with np.errstate(all="ignore"):
            tested = ~self.alike(x[:, 1], y[:, 1]) & np.isfinite(x[:, 1:3]).all(1) & np.isfinite(y[:, 1:3]).all(1)
            mean = (n * first.mean + m * second.mean) / (n + m)
            c = np.sqrt(chance.pooled_variance(first, second)) / np.abs(mean)
            skew = np.minimum(3 * c + c**3, math.sqrt(n + m))
            z = np.where(tested, chance.means(first, second, Skew(skew, skew)), 0.0)
        if not tested.any():
            return _Curve(0, None)
        i = int(np.argmax(np.abs(z)))
        return _Curve(
            int(tested.sum()), Difference(key, f"k = {x[i, 0]:g}", float(x[i, 1]), float(y[i, 1]), float(z[i]))
        )


def _same_bytes(a: Results, b: Results, common: bool) -> bool:
    """Whether the tables that both folders keep are equal; only runs.csv may be one folder's alone (a reference has
    none), or any table with `common`.
    """
    first, second = ({name: each.manifest["files"].get(name) for name in TABLES} for each in (a, b))
    missing = {name for name in TABLES if (first[name] is None) != (second[name] is None)}
    return (common or missing <= {RUNS}) and all(first[name] == second[name] for name in TABLES if name not in missing)


def _rows(results: Results) -> dict[Key, Row]:
    return {(row["reading"], row["case"], row["filter"], row["metric"]): row for row in results.summary}


def _curves(results: Results) -> dict[Key, Array]:
    """The curves of series.csv, each with the columns k, mean, se, median, first; an empty cell is NaN."""
    if "series.csv" not in results.manifest["files"]:
        return {}
    columns, rows = files.read_csv(results.folder / "series.csv")
    names = [columns.index(name) for name in ("reading", "case", "filter", "metric")]
    numbers = [columns.index(name) for name in CURVES]
    found: dict[Any, array[float]] = {}  # flat machine numbers: a fraction of the memory of records
    for row in rows:
        key = tuple(row[i] for i in names)
        found.setdefault(key, array("d")).extend([float(row[i] or "nan") for i in numbers])
    return {key: np.frombuffer(flat).reshape(-1, len(CURVES)) for key, flat in found.items()}


def _common_steps(x: Array, y: Array) -> tuple[Array, Array]:
    """The steps that both curves have."""
    return x[np.isin(x[:, 0], y[:, 0])], y[np.isin(y[:, 0], x[:, 0])]


def _largest(differences: Iterable[Difference]) -> list[Difference]:
    """Of each row the difference that tells most."""
    found: dict[Key, Difference] = {}
    for each in differences:
        if each.key not in found or abs(each.z) > abs(found[each.key].z):
            found[each.key] = each
    return list(found.values())


def _check(id: str) -> Key:
    return "", "", "", id


def _undefined(x: Any) -> bool:
    """An empty cell or a NaN."""
    return x is None or x != x


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
    if _undefined(row["mean"]):
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
