"""From values per run to the estimate of an estimand, with its standard error.

An estimand compares a few *points*; a point is a statistic over the runs of a metric, for a filter, in a case, where
each of the three may be arithmetic: metric innermost, then filter, then case. Everything is computed on the replicate
arrays of `replicates`, so all covariances of quantities from the same runs are in the standard error.

Runs without a number. A failed run has none: means are over the runs that failed nowhere, medians count it as +inf. A
sound run in which a metric is not defined (a share of no steps) is left out of that estimate. An infinite value of a
sound run (it never settles) stays: the median holds it, a mean does not exist.

Lost, failed and infinite runs make a mean meaningless, so with one of them an ordering is decided on the share of runs
in which it holds. What is compared may be arithmetic, D = sum c_j x_j over metrics, filters and cases (a - b; a growth
(a' - b') - (a - b)): the run counts for the ordering if D > margin, a tie one half. The x_j of a lost or failed run is
+inf; where infinite terms c_j x_j meet, those of one sign decide the run and those of both make a tie. Other arithmetic
than sums (a ratio) puts no two runs in order: with lost runs such an ordering is inconclusive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rkfbench.claims import replicates
from rkfbench.claims.combinations import along_least, least_eigenvalue, share_terms
from rkfbench.claims.estimand import Estimand, Point
from rkfbench.claims.verdict import Measured

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Key = tuple[str, str, str]  # metric, filter, case
Columns = Mapping[Key, Array]  # the values per run (M,) of each key


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
class Observation:
    """An estimand as observed: the measurement that decides, and what stands beside it."""

    measured: Measured
    decided_on: Literal["estimate", "wins", "nothing"] = "estimate"  # nothing: lost runs, and no order of single runs
    mean: float = float("nan")
    median: float = float("nan")
    failed: int = 0
    lost: int = 0
    chosen: str = ""


def observe(estimand: Estimand, stats: Stats, reading: str) -> Observation:
    """The estimate of an estimand under a reading, with its standard error and what stands beside it."""
    run = _Runs(estimand, stats, reading)
    lost, failed = run.any(stats.lost), run.any(stats.failed)
    ordered = estimand.ordered and estimand.statistic not in ("sd", "variance")
    decided_on: Literal["estimate", "wins", "nothing"] = "estimate"
    if ordered and run.indicator:  # lost runs leave shares as they are; for a - b > 0 there is the sign test
        decided_on = "wins" if run.plain and not estimand.margin else "estimate"
    elif ordered and (lost or failed or run.infinite):
        decided_on = "wins" if run.linear else "nothing"
    share = estimand.combine == "smallest"
    return Observation(
        measured=run.wins() if share or decided_on == "wins" else run.measure(estimand.statistic),
        decided_on=decided_on,
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
        """Whether there is no arithmetic in any point."""
        return all(point.plain for point in self.estimand.points)

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
    def infinite(self) -> bool:
        """Whether there is an infinite value."""
        return any(bool(np.isinf(column).any()) for column in self.values.values())

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
        return int(np.any([self._flags(flags, key) for key in self.keys], axis=0).sum())

    def _flags(self, flags: Callable[[str, str, str], Flags], key: Key) -> Flags:
        """Which runs are flagged for the filter and case of a key (M,)."""
        _, filter, case = key
        return np.asarray(flags(self.reading, case, self._chosen(filter, case)), bool)[: self.runs]

    def measure(self, statistic: str) -> Measured:
        """Estimate and standard error by replicate arrays, over the runs of `_columns`."""
        of, columns = replicates.STATISTICS[statistic], self._columns(statistic)
        used = next(iter(columns.values())).size
        if not used:
            return Measured(float("nan"), float("nan"), 0)
        if self.estimand.combine == "eigenvalue":
            return self._least(columns, of)
        with np.errstate(all="ignore"):
            parts = self._parts(columns, of)
            combined = _combine(self.estimand, parts)
        estimate, scale = float(combined[0]), _scale(self.estimand, parts, combined)
        if self.estimand.combine == "value" and self.plain and self.indicator and statistic == "mean":
            return Measured(estimate, replicates.standard_error(combined), used, "share", 0, 1.0)
        if self.linear and self.indicator and statistic == "mean":
            terms = share_terms(self._coefficients(), np.array(list(columns.values())))
            return Measured(estimate, replicates.standard_error(combined), used, "shares", 0, scale, terms)
        spread = statistic in ("sd", "variance") and self.estimand.combine in ("value", "ratio") and self.plain
        if spread and (combined > 0).all():
            return Measured(estimate, estimate * replicates.standard_error(np.log(combined)), used, "log", 0, scale)
        return Measured(estimate, replicates.standard_error(combined), used, "t", 0, scale)

    def estimate(self, statistic: Literal["mean", "median"]) -> float:
        """The estimate of `measure` alone."""
        of, columns = replicates.VALUES[statistic], self._columns(statistic)
        if not next(iter(columns.values())).size:
            return float("nan")
        with np.errstate(all="ignore"):
            return float(_combine(self.estimand, self._parts(columns, of))[0])

    def _parts(self, columns: Columns, of: Callable[[Array], Array]) -> list[Array]:
        """The statistic of every point, from the values per run of each key."""
        return [_evaluate(point, lambda *key: of(columns[key])) for point in self.estimand.points]

    def _least(self, columns: Columns, of: Callable[[Array], Array]) -> Measured:
        """The least eigenvalue of a mean matrix A, between two estimates that are right on one side each.

        Its direction is found on the runs, so the least eigenvalue of their mean is selected: it lies below that of A
        in the mean (the least eigenvalue is concave), much so where eigenvalues are close. That is the floor. u'Au >=
        the least one for every u: with u from the first half of the runs, the second half selects nothing, and its
        u'Au with its standard error is the estimate.
        """
        runs = next(iter(columns.values())).size
        first, second = ({key: column[half] for key, column in columns.items()} for half in _halves(runs))
        with np.errstate(all="ignore"):
            along = along_least(self._parts(second, of), [part[:1] for part in self._parts(first, of)])
            floor = float(least_eigenvalue([part[:1] for part in self._parts(columns, of)])[0])
        estimate, se = float(along[0]), replicates.standard_error(along)
        return Measured(estimate, se, runs, "least", 0, abs(estimate), floor=floor)

    def _columns(self, statistic: str) -> Columns:
        """The values that a statistic is taken of: of the runs that failed nowhere; for medians all, failed as +inf."""
        columns = self.values
        if statistic == "median" and not self.estimand.timing:
            columns = {key: self._with_failed(key) for key in self.keys}
        defined = ~np.isnan(np.array(list(columns.values()))).any(axis=0)
        return {key: column[defined] for key, column in columns.items()}

    def wins(self) -> Measured:
        """The share of runs in which the claimed order holds; a tie counts one half.

        Ordering: D > margin, as above. Smallest: the first below the smallest of the others.
        """
        columns = {key: self._with_lost(key) for key in self.keys}
        if self.estimand.combine == "smallest":
            first, *others = self.keys
            lead = _sum([np.min([columns[key] for key in others], axis=0), -columns[first]])
        else:
            coefficients = zip(self.keys, self._coefficients(), strict=True)
            lead = _sum([c * columns[key] for key, c in coefficients if c], -self.estimand.margin)
        lead = lead[~np.isnan(lead)]
        if not lead.size:
            return Measured(float("nan"), float("nan"), 0, "share")
        wins, ties = int((lead > 0).sum()), int((lead == 0).sum())
        replicate = replicates.mean((1 + np.sign(lead)) / 2)
        share = (wins + ties / 2) / lead.size
        return Measured(share, replicates.standard_error(replicate), lead.size, "share", ties, 1.0)

    def _with_lost(self, key: Key) -> Array:
        """The values with +inf (or -inf) for lost and failed runs; of 0/1 values as they are."""
        if self.estimand.timing or self.indicator:
            return self.values[key]
        worst = np.inf if self.estimand.lost == "largest" else -np.inf
        return np.where(self._flags(self.stats.lost, key), worst, self.values[key])

    def _with_failed(self, key: Key) -> Array:
        """The values with +inf for those that failed runs do not have."""
        missing = np.isnan(self.values[key])
        return np.where(missing & self._flags(self.stats.failed, key), np.inf, self.values[key])

    def _values(self, metric: str, filter: str, case: str) -> Array:
        filter = self._chosen(filter, case)
        if metric == "lost":
            return np.asarray(self.stats.lost(self.reading, case, filter), float)
        if metric == "failed":
            return np.asarray(self.stats.failed(self.reading, case, filter), float)
        return np.asarray(self.stats.values(self.reading, case, filter, metric), float)

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


def _halves(runs: int) -> tuple[slice, slice]:
    return slice(None, runs // 2), slice(runs // 2, None)


def _sum(terms: Sequence[Array], more: float = 0.0) -> Array:
    """The sum of terms (M,) each, and of a number: infinite of one sign where those meet, 0 of both; NaN with a NaN."""
    parts = np.array(terms)
    up, down = (parts == np.inf).any(axis=0), (parts == -np.inf).any(axis=0)
    with np.errstate(over="ignore"):
        total = np.where(np.isinf(parts), 0.0, parts).sum(axis=0) + more
    total = np.where(up | down, np.where(up & down, 0.0, np.where(up, np.inf, -np.inf)), total)
    return np.where(np.isnan(parts).any(axis=0), np.nan, total)


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
