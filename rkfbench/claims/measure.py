"""From values per run to the estimate of an estimand, with its standard error.

An estimand compares a few *points*; a point is a statistic over the runs of a metric, for a filter, in a case, where
each of the three may be arithmetic: metric innermost, then filter, then case. Everything is computed on the replicate
arrays of `replicates`, so all covariances of quantities from the same runs are in the standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rkfbench.claims import replicates
from rkfbench.claims.combinations import least_eigenvalue, share_terms
from rkfbench.claims.expression import Expression
from rkfbench.claims.verdict import Measured

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Combination = Literal["value", "difference", "relative", "ratio", "slope", "smallest", "eigenvalue"]


class Stats(Protocol):
    """What the results of one scenario say, run by run. A KeyError means: not computed (an extra that was not run).

    An attribute `tuning`, where there is one, is the same from runs with a seed of their own, to select filters on.
    """

    def values(self, reading: str, case: str, filter: str, metric: str) -> Array:
        """The metric of each run (M,), NaN where it failed; for metrics `time...` one value a repeat."""
        ...

    def lost(self, reading: str, case: str, filter: str) -> Flags:
        """Whether each run is lost (M,); failed runs are lost too."""
        ...

    def failed(self, reading: str, case: str, filter: str) -> Flags:
        """Whether each run failed (M,)."""
        ...

    def check(self, id: str) -> tuple[float, float]:
        """(deviation, tolerance) of an exact check."""
        ...


@dataclass(frozen=True)
class Selected:
    """A filter that is chosen on the tuning runs: the candidate with the smallest statistic of the metric."""

    candidates: tuple[str, ...]
    metric: str
    statistic: str = "mean"


@dataclass(frozen=True)
class Point:
    """One statistic: metric, filter and case, each a name or arithmetic over names."""

    metric: Expression
    filter: Expression
    case: Expression


@dataclass(frozen=True)
class Estimand:
    """What a cell of a claim is about.

    combine: value: the only point; difference: a - b; relative: (a - b)/b; ratio: a/b; slope: sum of weight x point;
    smallest: share of runs in which the first point is the smallest; eigenvalue: the least one of the symmetric matrix
    whose lower triangle the points are, row by row. `ordered` marks comparisons of runs that lost
    runs turn into a win probability.
    """

    combine: Combination
    points: tuple[Point, ...]
    statistic: str = "mean"
    weights: tuple[float, ...] = ()
    ordered: bool = False
    margin: float = 0.0  # of an ordering, for the comparison of single runs
    lost: Literal["largest", "smallest"] = "largest"
    selected: tuple[tuple[str, Selected], ...] = ()

    @property
    def timing(self) -> bool:
        """Whether it is made of clock values: every metric begins with `time`."""
        return all(name.startswith("time") for point in self.points for name in point.metric.names())


@dataclass(frozen=True)
class Observation:
    """An estimand as observed: the measurement that decides, and what stands beside it."""

    measured: Measured
    decided_on: Literal["estimate", "wins"] = "estimate"
    mean: float = float("nan")
    median: float = float("nan")
    failed: int = 0
    lost: int = 0
    chosen: str = ""


def observe(estimand: Estimand, stats: Stats, reading: str) -> Observation:
    """The estimate of an estimand under a reading, with its standard error and what stands beside it."""
    run = _Runs(estimand, stats, reading)
    lost, failed = run.any(stats.lost), run.any(stats.failed)
    comparable = estimand.ordered and estimand.statistic not in ("sd", "variance") and run.plain
    on_wins = comparable and bool(lost or failed or run.indicator)
    share = estimand.combine == "smallest"
    return Observation(
        measured=run.wins() if share or on_wins else run.measure(estimand.statistic),
        decided_on="wins" if on_wins else "estimate",
        mean=float("nan") if share else run.estimate("mean"),
        median=float("nan") if share else run.estimate("median"),
        failed=failed,
        lost=lost,
        chosen=", ".join(run.chosen.values()),
    )


class _Runs:
    """The values per run behind one estimand under one reading."""

    def __init__(self, estimand: Estimand, stats: Stats, reading: str) -> None:
        self.estimand, self.stats, self.reading = estimand, stats, reading
        self.select = dict(estimand.selected)
        self.chosen: dict[tuple[str, str], str] = {}
        self.keys = tuple(
            dict.fromkeys(
                (metric, filter, case)
                for point in estimand.points
                for case in point.case.names()
                for filter in point.filter.names()
                for metric in point.metric.names()
            )
        )
        columns = [self._values(*key) for key in self.keys]
        runs = min(column.size for column in columns)  # runs are a prefix of a longer study
        self.values = {key: column[:runs] for key, column in zip(self.keys, columns, strict=True)}
        self.runs = runs

    @property
    def plain(self) -> bool:
        """Whether every point is a single name in all three, so that runs can be compared one by one."""
        return all(part.name is not None for p in self.estimand.points for part in (p.metric, p.filter, p.case))

    @property
    def linear(self) -> bool:
        """Whether it is a sum of numbers times statistics."""
        parts = (part for p in self.estimand.points for part in (p.metric, p.filter, p.case))
        return self.estimand.combine in ("value", "difference", "slope") and all(part.degree == 1 for part in parts)

    def _coefficients(self) -> Array:
        """The number before the statistic of each key, where it is linear."""
        unit = dict(zip(self.keys, np.eye(len(self.keys)), strict=True))
        return _combine(self.estimand, [_evaluate(point, lambda *key: unit[key]) for point in self.estimand.points])

    @property
    def indicator(self) -> bool:
        """Whether the values are yes or no, as those of `lost`; a constant 0 or 1 of another metric need not be."""
        drawn = all(metric in ("lost", "failed") for metric, _, _ in self.keys)
        together = np.concatenate(list(self.values.values()))
        return bool(np.isin(together, (0.0, 1.0)).all()) and (drawn or np.unique(together).size == 2)

    def any(self, flags: Callable[[str, str, str], Flags]) -> int:
        """The number of runs flagged for any filter and case involved."""
        if self.estimand.timing:
            return 0
        hit = np.zeros(self.runs, bool)
        for _, filter, case in self.keys:
            hit |= np.asarray(flags(self.reading, case, self._chosen(filter, case)), bool)[: self.runs]
        return int(hit.sum())

    def measure(self, statistic: str) -> Measured:
        """Estimate and standard error by replicate arrays, over the runs of `_columns`."""
        of, columns = replicates.STATISTICS[statistic], self._columns(statistic)
        used = next(iter(columns.values())).size
        if not used:
            return Measured(float("nan"), float("nan"), 0)
        with np.errstate(all="ignore"):
            parts = [_evaluate(point, lambda *key: of(columns[key])) for point in self.estimand.points]
            combined = _combine(self.estimand, parts)
        estimate, scale = float(combined[0]), _scale(self.estimand, parts, combined)
        if self.estimand.combine == "value" and self.plain and self.indicator and statistic == "mean":
            return Measured(estimate, replicates.standard_error(combined), used, "share", 0, 1.0)
        if self.linear and self.indicator and statistic == "mean":
            terms = share_terms(self._coefficients(), np.array(list(columns.values())))
            return Measured(estimate, replicates.standard_error(combined), used, "shares", 0, scale, terms)
        return Measured(estimate, replicates.standard_error(combined), used, "t", 0, scale)

    def estimate(self, statistic: Literal["mean", "median"]) -> float:
        """The estimate of `measure` alone."""
        of, columns = replicates.VALUES[statistic], self._columns(statistic)
        if not next(iter(columns.values())).size:
            return float("nan")
        with np.errstate(all="ignore"):
            parts = [_evaluate(point, lambda *key: of(columns[key])) for point in self.estimand.points]
            return float(_combine(self.estimand, parts)[0])

    def _columns(self, statistic: str) -> dict[tuple[str, str, str], Array]:
        """The values that a statistic is taken of: of the runs that failed nowhere; for medians all, failed as +inf."""
        if statistic == "median":
            return {key: np.where(np.isnan(column), np.inf, column) for key, column in self.values.items()}
        valid = np.isfinite(np.array(list(self.values.values()))).all(axis=0)
        return {key: column[valid] for key, column in self.values.items()}

    def wins(self) -> Measured:
        """The share of runs in which the claimed order holds; a tie counts one half, a lost run as the largest value.

        Ordering a > b: a_i > b_i + margin. Smallest: the first below the smallest of the others.
        """
        columns = [self._with_lost(point) for point in self.estimand.points]
        with np.errstate(invalid="ignore"):
            if self.estimand.combine == "smallest":
                small, large = columns[0], np.min(columns[1:], axis=0)
            else:
                small, large = columns[1] + self.estimand.margin, columns[0]
        wins, ties = int((large > small).sum()), int((large == small).sum())
        share = (wins + ties / 2) / self.runs if self.runs else float("nan")
        replicate = replicates.mean(np.where(large > small, 1.0, np.where(large == small, 0.5, 0.0)))
        return Measured(share, replicates.standard_error(replicate), self.runs, "share", ties, 1.0)

    def _with_lost(self, point: Point) -> Array:
        """The values of a plain point with +inf (or -inf) for lost and failed runs; of 0/1 values as they are."""
        key = (point.metric.text.strip(), point.filter.text.strip(), point.case.text.strip())
        column = self.values[key]
        if self.estimand.timing or self.indicator:
            return column
        gone = np.asarray(self.stats.lost(self.reading, key[2], self._chosen(key[1], key[2])), bool)[: self.runs]
        worst = np.inf if self.estimand.lost == "largest" else -np.inf
        return np.where(gone | np.isnan(column), worst, column)

    def _values(self, metric: str, filter: str, case: str) -> Array:
        filter = self._chosen(filter, case)
        if metric == "lost":
            return np.asarray(self.stats.lost(self.reading, case, filter), float)
        if metric == "failed":
            return np.asarray(self.stats.failed(self.reading, case, filter), float)
        values = np.asarray(self.stats.values(self.reading, case, filter, metric), float)
        return np.where(np.isfinite(values), values, np.nan)

    def _chosen(self, filter: str, case: str) -> str:
        """The filter itself, or the candidate that a selection of this name takes in this case."""
        if filter not in self.select:
            return filter
        if (filter, case) not in self.chosen:
            tuning = getattr(self.stats, "tuning", None)
            if tuning is None:
                raise KeyError("tuning runs")
            choice = self.select[filter]
            of = replicates.STATISTICS[choice.statistic]

            def score(candidate: str) -> float:
                column = np.asarray(tuning.values(self.reading, case, candidate, choice.metric), float)
                value = float(of(np.where(np.isfinite(column), column, np.inf))[0])
                return value if np.isfinite(value) else np.inf  # a candidate that fails is not taken

            self.chosen[filter, case] = min(choice.candidates, key=score)
        return self.chosen[filter, case]


def _evaluate(point: Point, statistic: Callable[[str, str, str], Array]) -> Array:
    """The replicate array of a point: arithmetic over cases of arithmetic over filters of arithmetic over metrics."""
    return np.asarray(
        point.case.evaluate(
            lambda case: point.filter.evaluate(
                lambda filter: point.metric.evaluate(lambda metric: statistic(metric, filter, case))
            )
        )
    )


def _combine(estimand: Estimand, parts: list[Array]) -> Array:
    match estimand.combine:
        case "difference":
            return parts[0] - parts[1]
        case "relative":
            return (parts[0] - parts[1]) / parts[1]
        case "ratio":
            return parts[0] / parts[1]
        case "slope":
            return np.asarray(sum(w * part for w, part in zip(estimand.weights, parts, strict=True)))
        case "eigenvalue":
            return least_eigenvalue(parts)
        case _:
            return parts[0]


def _scale(estimand: Estimand, parts: Iterable[Array], combined: Array) -> float:
    """The level against which a margin is expressed in %: that of the second of two, 1 for relative numbers."""
    if estimand.combine in ("relative", "ratio", "smallest"):
        return 1.0
    levels = [abs(float(part[0])) for part in parts]
    return levels[1] if estimand.combine == "difference" else abs(float(combined[0]))
