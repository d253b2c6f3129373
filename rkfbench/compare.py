"""Two results folders side by side: the same bytes, the same numbers to a tolerance, or a statistical difference.

Numbers that differ by more than the tolerance are tested, each summary row by a z-value: on the paired differences of
the runs where both folders keep them and the seeds agree, else on the two means; where one has no mean, because no
run tracks or because it overflows, on the shares of runs left out or on the medians. The threshold is the Bonferroni
value of a 95 % family of all rows that are tested. Rows that only one folder has are differences.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Any, Literal

import numpy as np

from rkfbench.store.results import Results, Row

TOLERANCE = 1e-9  # relative: what another machine may change
FAMILY_ERROR = 0.05
TABLES = ("summary.csv", "series.csv", "filters.csv", "runs.csv", "checks.csv")

Key = tuple[str, str, str, str]  # reading, case, filter, metric
Level = Literal["same bytes", "same to the tolerance", "no statistical difference", "different"]


@dataclass(frozen=True)
class Difference:
    """A summary row whose means differ: by how much, in standard errors of the difference."""

    key: Key
    a: float | None
    b: float | None
    z: float  # infinite when the standard error is zero or a row is missing

    def swapped(self) -> Difference:
        """The same seen from the other side."""
        return Difference(self.key, self.b, self.a, -self.z)

    def as_row(self) -> Row:
        reading, case, filter, metric = self.key
        return {
            "reading": reading,
            "case": case,
            "filter": filter,
            "metric": metric,
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
    """The strongest level on which two results agree; with `common`, rows that only one of them has do not count."""
    first, second = _rows(a), _rows(b)
    if _same_bytes(a, b):
        return Comparison("same bytes", len(first))
    alone = [] if common else [*_alone(first, second), *(each.swapped() for each in _alone(second, first))]
    both = [key for key in first if key in second]
    apart = [key for key in both if not _close(first[key], second[key], tolerance)]
    if not apart and not alone:
        return Comparison("same to the tolerance", len(both))
    threshold = NormalDist().inv_cdf(1 - FAMILY_ERROR / 2 / len(apart)) if apart else math.inf
    tested = [
        Difference(key, first[key]["mean"], second[key]["mean"], _z(a, b, key, first[key], second[key]))
        for key in apart
        if not _equal(first[key]["mean"], second[key]["mean"], tolerance)  # what has no chance in it rounds only
    ]
    differences = alone + [each for each in tested if not abs(each.z) <= threshold]
    level: Level = "different" if differences else "no statistical difference"
    return Comparison(level, len(both), threshold, differences)


def _same_bytes(a: Results, b: Results) -> bool:
    """Whether the tables that both folders keep are equal (a reference has no runs.csv)."""
    first, second = a.manifest["files"], b.manifest["files"]
    return all(first[name] == second[name] for name in TABLES if name in first and name in second)


def _rows(results: Results) -> dict[Key, Row]:
    return {(row["reading"], row["case"], row["filter"], row["metric"]): row for row in results.summary}


def _alone(first: Mapping[Key, Row], second: Mapping[Key, Row]) -> list[Difference]:
    return [Difference(key, row["mean"], None, math.inf) for key, row in first.items() if key not in second]


def _close(first: Row, second: Row, tolerance: float) -> bool:
    """Whether all statistics of a row agree; counts of runs, failed and lost must be equal."""
    columns = ("runs", "failed", "lost", "mean", "se", "sd", "median", "q05", "q95")
    return all(_equal(first[column], second[column], tolerance) for column in columns)


def _equal(x: Any, y: Any, tolerance: float) -> bool:
    if _undefined(x) or _undefined(y):
        return _undefined(x) and _undefined(y)
    return x == y or math.isclose(x, y, rel_tol=tolerance)


def _undefined(x: Any) -> bool:
    """An empty cell or a NaN."""
    return x is None or x != x


def _z(a: Results, b: Results, key: Key, first: Row, second: Row) -> float:
    """The difference of the means in standard errors; zero where neither folder has a mean."""
    if a.seed == b.seed and a.has_runs and b.has_runs:
        x, y = a.values(*key), b.values(*key)
        runs = min(len(x), len(y))
        difference = x[:runs] - y[:runs]
        difference = difference[np.isfinite(difference)]
        if len(difference) > 1:
            return _ratio(float(difference.mean()), float(difference.std(ddof=1)) / math.sqrt(len(difference)))
    if _undefined(first["mean"]) or _undefined(second["mean"]):  # where both are, no row is tested
        empty = second if _undefined(second["mean"]) else first
        return _z_left_out(first, second) if _left_out(empty) == empty["runs"] else math.inf
    if math.isinf(first["mean"]) or math.isinf(second["mean"]):
        return _z_medians(first, second)
    return _ratio(first["mean"] - second["mean"], _pooled_se(first, second))


def _left_out(row: Row) -> int:
    """The runs that failed or were lost (one that failed is lost too, where anything is said of that): where these are
    all, none tracks.
    """
    return int(max(row["failed"], row["lost"]))


def _z_left_out(first: Row, second: Row) -> float:
    """The difference of the shares of runs left out in standard errors of equal shares."""
    (out, n), (others, m) = ((_left_out(row), row["runs"]) for row in (first, second))
    share = (out + others) / (n + m)
    return _ratio(out / n - others / m, math.sqrt(share * (1 - share) * (1 / n + 1 / m)))


def _z_medians(first: Row, second: Row) -> float:
    """The difference of the medians, where single runs make a mean overflow; their standard errors are those of a
    normal law with the 5 % and 95 % quantiles of the rows.
    """
    width = 2 * NormalDist().inv_cdf(0.95)
    squares = (math.pi / 2 * ((row["q95"] - row["q05"]) / width) ** 2 / row["runs"] for row in (first, second))
    z = _ratio(first["median"] - second["median"], math.sqrt(sum(squares)))
    return math.inf if _undefined(z) else z


def _pooled_se(first: Row, second: Row) -> float:
    """Standard error of a difference of means of the same law: the spread is that of all runs of both together.

    So a mean of equal values in few runs (no outlier in 100 of them) does not pass for a number without chance.
    """
    counts = [max(row["runs"] - row["failed"], 1) for row in (first, second)]
    squares = sum((n * (row["se"] or 0.0)) ** 2 for n, row in zip(counts, (first, second), strict=True))
    return math.sqrt(squares / sum(counts) * sum(1 / n for n in counts))


def _ratio(difference: float, se: float) -> float:
    if difference == 0:
        return 0.0
    return difference / se if se > 0 else math.copysign(math.inf, difference)
