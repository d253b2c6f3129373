"""Two results folders row by row: what only one of them has, and whether the cells of both agree to a tolerance."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench.store import files
from rkfbench.store.results import Results, Row

TOLERANCE = 1e-9  # relative: what another machine may change
STATISTICS = ("runs", "failed", "lost", "mean", "se", "sd", "median", "q05", "q95", "max")
CURVES = ("k", "mean", "se", "median", "first")

Key = tuple[str, str, str, str]  # reading, case, filter, metric
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

    @property
    def only(self) -> str:
        """Which folder alone has it, "a" or "b"; "" for what both have."""
        one = self.what in ("row", "curve") or (self.what == "check" and None in (self.a, self.b))
        return "" if not one else "a" if self.z > 0 else "b"

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


class Pair:
    """Two folders with their rows by key."""

    def __init__(self, a: Results, b: Results) -> None:
        self.a, self.b = a, b
        self.first, self.second = _rows(a), _rows(b)
        self.rows = [key for key in self.first if key in self.second]
        self.paired = a.seed == b.seed and a.has_runs and b.has_runs

    @cached_property
    def series(self) -> tuple[dict[Key, Array], dict[Key, Array]]:
        """The curves of both, by key."""
        return _curves(self.a), _curves(self.b)

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

    def is_extra(self, alone: Difference) -> bool:
        """Whether what only one of them has is there because that one was run in full, and the other was not."""
        mine, other = (self.a, self.b) if alone.only == "a" else (self.b, self.a)
        return bool(mine.manifest.get("full")) and not other.manifest.get("full")

    def crossed(self) -> Iterator[Difference]:
        """Exact checks that one folder passes and the other does not."""
        for id in self.a.checks.keys() & self.b.checks.keys():
            (x, limit), (y, other) = self.a.check(id), self.b.check(id)
            if (x <= limit) != (y <= other):
                yield Difference(_check(id), "check", x, y, math.copysign(math.inf, x - y))

    def close(self) -> bool:
        """Whether all cells that both have agree to the tolerance."""
        return (
            all(self.same_row(self.first[key], self.second[key]) for key in self.rows)
            and self._same_filters()
            and self._same_checks()
            and self._same_curves()
        )

    def same_row(self, first: Row, second: Row, columns: Iterable[str] = STATISTICS) -> bool:
        """Whether all statistics of a row agree; counts of runs, failed and lost must be equal."""
        return all(self.equal(first.get(column), second.get(column)) for column in columns)

    def _same_filters(self) -> bool:
        """Whether filters of the same label have the same parameters."""
        first, second = ({row["label"]: row for row in each.filters} for each in (self.a, self.b))
        return all(self.same_row(first[key], second[key], first[key] | second[key]) for key in first if key in second)

    def _same_checks(self) -> bool:
        """Whether checks deviate alike; what lies within its tolerance is rounding."""
        return all(
            self.equal(limit, self.b.checks[id][1])
            and math.isclose(x, self.b.checks[id][0], rel_tol=TOLERANCE, abs_tol=limit)
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
        if undefined(x) or undefined(y):
            return undefined(x) and undefined(y)
        numbers = isinstance(x, int | float) and isinstance(y, int | float)
        return x == y or bool(numbers and math.isclose(x, y, rel_tol=TOLERANCE))

    def alike(self, x: Array, y: Array | float) -> NDArray[np.bool_]:
        """Where numbers agree to the tolerance, or neither is one."""
        with np.errstate(invalid="ignore", over="ignore"):
            near = np.abs(x - y) <= TOLERANCE * np.maximum(np.abs(x), np.abs(y))
        return (x == y) | (near & np.isfinite(x) & np.isfinite(y)) | (np.isnan(x) & np.isnan(y))


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


def _check(id: str) -> Key:
    return "", "", "", id


def undefined(x: Any) -> bool:
    """An empty cell or a NaN."""
    return x is None or x != x
