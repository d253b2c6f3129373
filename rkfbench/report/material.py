"""What figures and tables are made of: the results of one scenario, indexed, and which of them a declaration picks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from rkfbench.claims.expression import parse
from rkfbench.report.words import PLAIN, Words
from rkfbench.scenario.display import Item, Selection, Statistic, case_matches, metrics_in
from rkfbench.times import is_time

if TYPE_CHECKING:
    from rkfbench.scenario.paper_schema import PrintedTable
    from rkfbench.store import Results

Row = Mapping[str, Any]
Key = tuple[str, str, str, str]  # reading, case, filter, metric


@dataclass(frozen=True)
class Material:
    """The results of a scenario with what its figures and tables need to know besides numbers."""

    results: Results
    extra_filters: frozenset[str] = frozenset()
    extra_cases: frozenset[str] = frozenset()
    readings: tuple[str, ...] = ()  # of the scenario; the results may also hold sensitivity switches
    printed: Mapping[str, PrintedTable] = field(default_factory=dict)  # the paper's tables by name
    words: Words = PLAIN

    @cached_property
    def summary(self) -> dict[Key, Row]:
        """Computed numbers, measured times, and the shares of failed and lost runs as metrics of those names."""
        rows: dict[Key, Row] = {key_of(row): row for row in self.results.summary}
        for (reading, case, label, _), row in list(rows.items()):
            for what in ("failed", "lost"):
                if row.get(what) is not None:
                    rows.setdefault((reading, case, label, what), _share(row, what))
        times = self.results.timings.get("times", ())  # repeats are no runs, of which some might fail
        return rows | {key_of(row): row for row in times}

    @cached_property
    def series(self) -> dict[Key, list[Row]]:
        curves: dict[Key, list[Row]] = {}
        for row in self.results.series:
            curves.setdefault(key_of(row), []).append(row)
        return curves

    @cached_property
    def timed(self) -> set[str]:
        """The readings under which times were measured: they change numbers, not times."""
        return {key[0] for key in self.summary if is_time(key[3])}

    @cached_property
    def counts(self) -> dict[tuple[str, str, str], tuple[int, int, int]]:
        """(reading, case, filter) -> runs, failed runs, lost runs."""
        return {key_of(row)[:3]: (row["runs"], row["failed"], row["lost"]) for row in self.results.summary}

    @cached_property
    def cells(self) -> dict[str, list[str]]:
        """The cases of each reading: those of the scenario first, then switches of the sensitivity study."""
        found: dict[str, dict[str, None]] = {}
        for reading, case, _, _ in (*self.summary, *self.series):
            found.setdefault(reading, {})[case] = None
        return {each: list(found[each]) for each in distinct([*self.readings, *found]) if each in found}

    @cached_property
    def filters(self) -> dict[str, Row]:
        """Label -> its row of filters.csv, the first where readings or cases give it other parameters."""
        rows: dict[str, Row] = {}
        for row in self.results.filters:
            rows.setdefault(text(row["label"]), row)
        return rows

    @cached_property
    def names(self) -> dict[str, str]:
        """Label -> name of the filter in the catalogue."""
        return {label: text(row.get("name")) or label for label, row in self.filters.items()}

    @cached_property
    def sweep_columns(self) -> tuple[str, ...]:
        """What stands between `case` and `filter` in summary.csv."""
        columns = list(self.results.summary[0]) if self.results.summary else []
        return tuple(columns[columns.index("case") + 1 : columns.index("filter")]) if columns else ()

    @property
    def own_readings(self) -> list[str]:
        """The readings of the scenario for which there are results, without switches."""
        return [each for each in self.cells if not self.readings or each in self.readings]

    def pick_readings(self, item: Item) -> list[str]:
        return self.own_readings if item.readings is None else [each for each in self.cells if each in item.readings]

    def pick_cases(self, item: Selection, reading: str, extras: bool = False) -> list[str]:
        if item.cases is not None:
            there = self.cells[reading]
            return distinct(case for name in item.cases for case in there if case_matches(name, case))
        return [case for case in self.cells[reading] if extras or case not in self.extra_cases]

    def pick_filters(self, item: Selection) -> list[str]:
        if item.filters is not None:
            there = {key[2] for key in self.summary} | self.filters.keys()  # some are only timed
            return [label for label in item.filters if label in there]
        return [label for label in self.filters if label not in self.extra_filters]

    def row(self, key: Key) -> Row | None:
        """The row of the summary; for arithmetic over metrics, the same arithmetic over the statistics of their rows.

        None where something was not computed.
        """
        if key in self.summary:
            return self.summary[key]
        found = {name: self.summary.get((*key[:3], name)) for name in metrics_in(key[3])}
        parts = {name: row for name, row in found.items() if row is not None}
        if len(parts) < len(found):
            return None

        def combined(statistic: str) -> float:
            with np.errstate(all="ignore"):
                return float(parse(key[3]).evaluate(lambda name: np.float64(number(parts[name].get(statistic)))))

        first = next(iter(parts.values()))
        return {**first, "metric": key[3], "se": None} | {each: combined(each) for each in get_args(Statistic)}

    def estimate(self, key: Key, statistic: str) -> tuple[float, float | None]:
        """A statistic of the runs, or arithmetic over such, and its standard error.

        The error of any but the mean of one metric needs the numbers per run, and the largest value has none.
        """
        row = self.row(key)
        if row is None:
            raise KeyError(key)
        in_summary = key in self.summary and (statistic == "mean" or key[3] in ("failed", "lost"))
        if in_summary or statistic == "max" or not self.has_values(key[3]):
            return number(row.get(statistic)), row["se"] if statistic == "mean" else None
        from rkfbench.claims.replicates import standard_error

        replicated = _replicated(key[3], self._columns(key, statistic), statistic)
        return float(replicated[0]), standard_error(replicated)

    def rank_interval(self, key: Key) -> tuple[float, float]:
        """The 95 % interval of a median between two of the runs; NaN where it needs more runs, or their numbers."""
        if key[3] in ("failed", "lost") or not self.has_values(key[3]):
            return math.nan, math.nan
        from rkfbench.claims.replicates import rank_interval

        values = self._columns(key, "median")[key[3]]
        return rank_interval(values[~np.isnan(values)])

    def batches(self, key: Key, statistic: str, size: int) -> list[float]:
        """A statistic over disjoint batches of `size` runs; [] where there are no numbers per run."""
        if key[3] in ("failed", "lost") or is_timing(key[3]) or not self.results.has_runs:
            return []
        columns = self._columns(key, statistic)
        runs = len(next(iter(columns.values())))
        batches = (slice(first, first + size) for first in range(0, runs - size + 1, size))
        parts = ({name: column[batch] for name, column in columns.items()} for batch in batches)
        return [float(_replicated(key[3], part, statistic)[0]) for part in parts]

    def _columns(self, key: Key, statistic: str) -> dict[str, Any]:
        """The numbers of single runs (M,) of each metric involved; failed runs are infinite for a median, else NaN."""
        columns = {}
        for name in (key[3],) if key in self.summary else metrics_in(key[3]):
            values, failed = self._values((*key[:3], name))
            columns[name] = np.where(failed, np.inf if statistic == "median" else np.nan, values)
        return columns

    def _values(self, key: Key) -> tuple[Any, Any]:
        """The numbers of single runs or repeats, and which runs failed, (M,) each."""
        if key[3] in ("failed", "lost"):
            flags = self.results.failed(*key[:3]) if key[3] == "failed" else self.results.lost(*key[:3])
            return flags.astype(float), np.zeros(len(flags), bool)
        values = self.results.values(*key)
        if is_time(key[3]):
            return values, np.zeros(len(values), bool)
        return np.sqrt(values) if is_root(key[3]) else values, self.results.failed(*key[:3])

    def has_values(self, metric: str) -> bool:
        """Whether the numbers of single runs are there; those of times always are."""
        return self.results.has_runs or is_timing(metric)

    def parameter_values(self, family: str, parameter: str) -> dict[str, float | str]:
        """Label -> value of a parameter, in its order, for the filters that are labelled `family` or `family[...]`; for
        all of that name when none is. So another label (`fpmcs-floor05`) keeps variants out of a sweep.
        """
        same = [label for label, name in self.names.items() if name == family]
        same = [label for label in same if label.partition("[")[0] == family] or same
        found = {label: value for label in same if (value := self.filters[label].get(parameter)) is not None}
        return dict(sorted(found.items(), key=lambda item: (isinstance(item[1], str), item[1])))


def printed_numbers(table: PrintedTable) -> dict[tuple[str, str, str, str], float]:
    """(filter, case, metric, statistic) -> the number that a paper's table prints for it."""
    numbers = {}
    for row in table.rows:
        for column, value in table.numbers(row):
            if value is not None:
                cell = table.cell(row, column)
                numbers[cell["filter"], cell["case"], cell["metric"], cell["statistic"]] = value
    return numbers


def is_timing(metric: str) -> bool:
    """Whether a metric, or all that stands in arithmetic over metrics, is measured with a clock."""
    return all(is_time(name) for name in metrics_in(metric))


def distinct(values: Iterable[Any]) -> list[Any]:
    """Values without repetition, in order of first appearance."""
    return list(dict.fromkeys(values))


def text(value: Any) -> str:
    return "" if value is None else str(value)


def number(value: Any) -> float:
    return math.nan if value is None else float(value)


def _replicated(metric: str, columns: Mapping[str, Any], statistic: str) -> Any:
    """A statistic over the runs of `columns`, or arithmetic over the statistics of several, with its replicates.

    Runs are paired: one in which any of them is undefined is left out. A root mean square is one over the runs, too.
    """
    from rkfbench.claims import replicates

    there = ~np.isnan(list(columns.values())).any(axis=0)

    def of(name: str) -> Any:
        pooled = statistic == "mean" and is_root(name)
        return (replicates.rms if pooled else replicates.STATISTICS[statistic])(columns[name][there])

    with np.errstate(all="ignore"):
        return of(metric) if metric in columns else parse(metric).evaluate(of)


def is_root(metric: str) -> bool:
    """Whether the mean of a metric is the root of the mean square over the runs, as that of `pooled_rmse`."""
    from rkfbench import metrics

    if metric in ("failed", "lost") or is_time(metric):
        return False
    return metrics.get(metric).root


def _share(row: Row, what: str) -> Row:
    """The share of failed or lost runs with its standard error, as a row of the summary.

    The error is the standard deviation of what is known of a share after k of n runs, every share being as likely
    before: p (1 - p)/(n + 3) with p = (k + 1)/(n + 2). So none lost of 1000 runs is 0 +- 0.001, and not +- 0.
    """
    count, runs = row[what], row["runs"]
    share = count / runs if runs else math.nan
    likely = (count + 1) / (runs + 2)
    se = math.sqrt(likely * (1 - likely) / (runs + 3)) if runs else None
    return {**row, "metric": what, "mean": share, "se": se, "sd": None, "median": None, "failed": 0, "lost": 0}


def key_of(row: Row) -> Key:
    return text(row["reading"]), text(row["case"]), text(row["filter"]), text(row["metric"])
