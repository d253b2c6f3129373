"""The numbers of a table: ours with standard errors, the paper's printed number beside each, and how they compare.

Under a printed number stand the ratio ours/printed, z = (ours - printed)/sqrt(se^2 + se_p^2), and, where our runs are
some multiple of the paper's, the range of our number over disjoint batches of as many runs as the paper had. se_p is
the standard error of the printed number: printed sd/sqrt(n) of a mean whose sd is printed too, else from our own runs.
What is the same in every run (a covariance that no measurement moves) has no z.

They are tidy, one number a line of a table's CSV, and everything else is laid out from them by `tables`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from rkfbench.report.computed import COMPUTED
from rkfbench.report.material import Material, is_timing, printed_numbers, text
from rkfbench.report.numbers import Written, fixed, written
from rkfbench.report.words import Words
from rkfbench.scenario.display import Table, metrics_in
from rkfbench.store import files

EXACT = 1e-12  # a spread below this share of the value is rounding: nothing random, so no z
COUNT = "count"  # the statistic of what is counted exactly


class Entry(NamedTuple):
    """One number of a table. `row` and `column` are the headings under which it stands."""

    reading: str
    row: str
    column: str
    case: str
    filter: str
    metric: str
    statistic: str
    value: float | None
    se: float | None
    printed: float | None
    median: float | None
    runs: int | None
    failed: int | None
    lost: int | None
    ratio: float | None = None  # ours/printed
    z: float | None = None
    batch_runs: int | None = None  # the paper's number of runs
    batches: int | None = None
    batch_low: float | None = None
    batch_high: float | None = None

    @property
    def written(self) -> Written:
        if self.value is not None and self.statistic == COUNT:
            return Written(fixed(self.value, 0))
        return Written("–") if self.value is None else written(self.value, self.se)

    @property
    def note(self) -> str:
        """Where runs failed or were lost a mean may say little: the median stands beside it."""
        if self.statistic != "mean" or not (self.failed or self.lost) or self.median is None:
            return ""
        return f"median {written(self.median).text()}"


def of(table: Table, material: Material) -> list[Entry]:
    """The numbers of a table under all its readings; cells that were not computed are left out."""
    if table.computed:
        return [_count(*cell) for cell in COMPUTED[table.computed]()]
    printed = material.printed.get(table.paper) if table.paper else None
    numbers = printed_numbers(printed) if printed else {}
    found = []
    for reading in material.pick_readings(table):
        if table.metric is None:
            places = _as_printed_layout(printed) if printed else []
        else:
            places = _own_layout(table, material, reading)
        for row, column, (label, case, metric, statistic) in places:
            ours = material.row((reading, case, label, metric))
            theirs = numbers.get((label, case, metric, statistic))
            timed_elsewhere = is_timing(metric) and reading not in material.timed
            if ours is None and (theirs is None or timed_elsewhere):
                continue
            value: float | None = None
            se = median = runs = failed = lost = None
            if ours is not None:
                value, se = material.estimate((reading, case, label, metric), statistic)
                value = None if math.isnan(value) and ours.get(statistic) is None else value
                median, runs, failed, lost = ours.get("median"), ours["runs"], ours.get("failed"), ours.get("lost")
            place = (reading, row, column, case, label, metric, statistic)
            entry = Entry(*place, value, se, theirs, median, runs, failed, lost)
            if printed and theirs is not None and value is not None and not is_timing(metric):
                spread = numbers.get((label, case, metric, "sd")) if statistic == "mean" else None
                entry = _compared(entry, printed.runs, spread, material)
            found.append(entry)
    return found


def _count(row: str, column: str, count: int) -> Entry:
    nothing = dict.fromkeys(("se", "printed", "median", "runs", "failed", "lost"))
    return Entry("", row, column, "", "", "", COUNT, count, **nothing)


def _compared(entry: Entry, n: int, spread: float | None, material: Material) -> Entry:
    """The entry with ratio, z and range of batches against a number printed from n runs, whose sd may be printed."""
    ours, printed = entry.value, entry.printed
    assert ours is not None
    assert printed is not None
    z = None
    if entry.se and entry.runs and entry.se > EXACT * abs(ours):
        se_p = entry.se * math.sqrt(entry.runs / n)
        if entry.statistic == "sd":
            se_p *= printed / ours
        elif spread is not None:
            se_p = spread / math.sqrt(n)
        z = (ours - printed) / math.hypot(entry.se, se_p)
    entry = entry._replace(ratio=ours / printed if printed else None, z=z)
    key = (entry.reading, entry.case, entry.filter, entry.metric)
    batches = material.batches(key, entry.statistic, n) if (entry.runs or 0) >= 2 * n else []
    if not batches:
        return entry
    return entry._replace(batch_runs=n, batches=len(batches), batch_low=min(batches), batch_high=max(batches))


def needs_runs(table: Table) -> bool:
    """Whether some error or range comes from numbers per run, which a committed folder does not keep."""
    arithmetic = any(metrics_in(metric) != (metric,) for metric in table.metrics)
    return arithmetic or bool({"median", "sd"} & set(table.statistics)) or table.paper is not None


def write(path: Path, found: Iterable[Entry]) -> None:
    files.write_csv(path, Entry._fields, found)


def read(path: Path) -> list[Entry]:
    """What `write` wrote."""
    texts = ("reading", "row", "column", "case", "filter", "metric", "statistic")
    return [Entry(**{**row, **{name: text(row[name]) for name in texts}}) for row in files.read_records(path)]


def _as_printed_layout(printed: Any) -> Iterable[tuple[str, str, tuple[str, str, str, str]]]:
    for row, column in product(printed.rows, printed.columns):
        cell = printed.cell(row, column)
        yield row.label, column.label, (cell["filter"], cell["case"], cell["metric"], cell["statistic"])


def _own_layout(table: Table, material: Material, reading: str) -> Iterable[tuple[str, str, tuple[str, str, str, str]]]:
    """Every combination of case, filter, metric and statistic with the headings of its row and column."""
    values = {
        "case": material.pick_cases(table, reading),
        "filter": material.pick_filters(table),
        "metric": table.metrics,
        "statistic": table.statistics,
    }
    columns = _listed(table.columns) or ["filter"]
    rows = _listed(table.rows) or [each for each in ("case",) if each not in columns]
    rows += [each for each in values if each not in (*rows, *columns) and len(values[each]) > 1]
    order = [*rows, *columns, *(each for each in values if each not in (*rows, *columns))]
    names: dict[str, Callable[[str], str]] = {
        "case": material.words.case,
        "filter": material.words.filter,
        "metric": metric_names(table.metrics, material.words).__getitem__,
        "statistic": str,
    }
    for combination in product(*(values[each] for each in order)):
        cell: dict[str, str] = dict(zip(order, combination, strict=True))
        row = ", ".join(names[each](cell[each]) for each in rows if cell[each])
        column = ", ".join(names[each](cell[each]) for each in columns if cell[each])
        yield row, column, (cell["filter"], cell["case"], cell["metric"], cell["statistic"])


def metric_names(metrics: Sequence[str], words: Words) -> dict[str, str]:
    """What the metrics of a table are called; `a.py:worst` and `b.py:worst` keep their files to have places apart."""
    names = {metric: words.metric(metric) for metric in metrics}
    count = Counter(names.values())
    return {metric: metric if count[name] > 1 and ":" in metric else name for metric, name in names.items()}


def _listed(dimensions: Any) -> list[str]:
    return [dimensions] if isinstance(dimensions, str) else list(dimensions or ())
