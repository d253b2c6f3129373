"""Tables: ours with standard errors, the paper's printed number beneath each; as CSV, Markdown and LaTeX.

Under a printed number stand the ratio ours/printed, z = (ours - printed)/sqrt(se^2 + se_p^2), and, where our runs are
some multiple of the paper's, the range of our number over disjoint batches of as many runs as the paper had. se_p is
the standard error of the printed number: printed sd/sqrt(n) of a mean whose sd is printed too, else from our own runs.
What is the same in every run (a covariance that no measurement moves) has no z.

The CSV is tidy, one number a line, and everything else is laid out from it: `entries` picks numbers out of the results,
`layouts` puts them into rows and columns, one sheet a reading, and `markdown` and `latex` write the sheets down.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

from rkfbench.report.captions import casualties
from rkfbench.report.computed import COMPUTED
from rkfbench.report.material import Material, distinct, is_time, printed_numbers, text
from rkfbench.report.numbers import SUPERSCRIPT, Written, as_printed, fixed, written
from rkfbench.report.words import PLAIN, Words
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


@dataclass(frozen=True)
class Line:
    """A row: ours, and the paper's numbers when it prints some, with lines (heading, cells) on how the two compare."""

    heading: str
    cells: tuple[Entry | None, ...]
    printed: tuple[str, ...] = ()
    against: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def beneath(self) -> list[tuple[str, tuple[str, ...]]]:
        """The lines (heading, cells) under a row for which the paper prints numbers."""
        return [("paper", self.printed), *self.against] if self.printed else []


@dataclass(frozen=True)
class Sheet:
    """A table under one reading, laid out."""

    reading: str
    headings: tuple[str, ...]
    lines: tuple[Line, ...]
    note: str


def entries(table: Table, material: Material) -> list[Entry]:
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
            timed_elsewhere = is_time(metric) and reading not in material.timed
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
            if printed and theirs is not None and value is not None and not is_time(metric):
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


def layouts(table: Table, found: Sequence[Entry], decimals: int | None = None, words: Words = PLAIN) -> list[Sheet]:
    """The entries as sheets, one a reading."""
    sheets = []
    for reading in distinct(entry.reading for entry in found):
        mine = [entry for entry in found if entry.reading == reading]
        columns = distinct(entry.column for entry in mine)
        at = {(entry.row, entry.column): entry for entry in mine}
        lines = []
        for row in distinct(entry.row for entry in mine):
            cells = tuple(at.get((row, column)) for column in columns)
            numbers = [None if cell is None else cell.printed for cell in cells]
            printed = tuple("" if number is None else as_printed(number, decimals) for number in numbers)
            lines.append(Line(row, cells, printed, _against(cells)) if any(printed) else Line(row, cells))
        sheets.append(Sheet(reading, tuple(columns), tuple(lines), _note(table, mine, words)))
    return sheets


def _against(cells: Sequence[Entry | None]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """The lines under the printed numbers: ratio and z; range of the batches."""
    ratios = ["" if cell is None or cell.ratio is None else f"{cell.ratio:#.3g}" for cell in cells]
    zs = ["" if cell is None or cell.z is None else _signed(cell.z) for cell in cells]
    ranges = ["" if cell is None else _range(cell) for cell in cells]
    counts = distinct(f"{cell.batches} × {cell.batch_runs}" for cell in cells if cell and cell.batches)
    lines = {
        "ours/paper; z": tuple("; ".join(filter(None, pair)) for pair in zip(ratios, zs, strict=True)),
        f"range of {' or '.join(counts)} runs": tuple(ranges),
    }
    return tuple((heading, line) for heading, line in lines.items() if any(line))


def _signed(z: float) -> str:
    return ("+" if round(z, 1) > 0 else "") + fixed(z, 1)


def _range(cell: Entry) -> str:
    if cell.batch_low is None or cell.batch_high is None:
        return ""
    return f"{written(cell.batch_low).text()} to {written(cell.batch_high).text()}"


def write_entries(path: Path, found: Iterable[Entry]) -> None:
    files.write_csv(path, Entry._fields, found)


def read_entries(path: Path) -> list[Entry]:
    """What `write_entries` wrote."""
    texts = ("reading", "row", "column", "case", "filter", "metric", "statistic")
    return [Entry(**{**row, **{name: text(row[name]) for name in texts}}) for row in files.read_records(path)]


def markdown(table: Table, sheets: Sequence[Sheet], level: int = 1) -> str:
    """The sheets as Markdown tables; the paper's numbers in lines of their own."""
    parts = [f"{'#' * level} {table.title or table.id}", *([table.caption] if table.caption else [])]
    for sheet in sheets:
        rows = [["", *sheet.headings]]
        for line in sheet.lines:
            rows.append([line.heading, *("" if cell is None else _plain(cell) for cell in line.cells)])
            rows += [[f"*{each}*" if each else "" for each in (heading, *cells)] for heading, cells in line.beneath]
        escaped = [" | ".join(cell.replace("|", r"\|") for cell in row) for row in rows]
        rule = " | ".join(["---", *["---:"] * len(sheet.headings)])
        parts.append("\n".join(f"| {row} |" for row in (escaped[0], rule, *escaped[1:])))
        parts.append(sheet.note)
    return "\n\n".join(parts) + "\n"


def latex(table: Table, sheets: Sequence[Sheet]) -> str:
    """The sheets as LaTeX tables in the style of the booktabs package."""
    return "\n".join(_latex_sheet(table, sheet) for sheet in sheets)


def escape(plain: str) -> str:
    """Plain text as LaTeX."""
    return re.sub(r"[\\&%$#_{}~^×±∞−–·⁻⁰¹²³⁴⁵⁶⁷⁸⁹]", lambda match: _TEX[match[0]], plain)


_TEX: Mapping[str, str] = {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "×": r"$\times$", "±": r"$\pm$", "∞": r"$\infty$", "−": r"$-$", "–": "--", "·": r"$\cdot$",
    **{character: "\\" + character for character in "&%$#_{}"},
    **{chr(raised): rf"\textsuperscript{{{chr(plain)}}}" for plain, raised in SUPERSCRIPT.items()},
}  # fmt: skip


def _latex_sheet(table: Table, sheet: Sheet) -> str:
    def row(heading: str, cells: Iterable[str]) -> str:
        return " & ".join([heading, *cells]) + r" \\"

    body = [row("", map(escape, sheet.headings)), r"\midrule"]
    for line in sheet.lines:
        body.append(row(escape(line.heading), ("" if cell is None else _tex(cell) for cell in line.cells)))
        for heading, cells in line.beneath:
            italic = (rf"\textit{{{escape(number)}}}" if number else "" for number in cells)
            body.append(row(rf"\quad\textit{{{escape(heading)}}}", italic))
    caption = " ".join(part for part in (f"{table.title or table.id}.", table.caption, sheet.note) if part)
    label = "-".join(part for part in (table.id, re.sub(r"[^A-Za-z0-9]+", "-", sheet.reading)) if part)
    head = [r"\begin{table}", r"\centering", rf"\caption{{{escape(caption)}}}", rf"\label{{tab:{label}}}"]
    frame = [rf"\begin{{tabular}}{{l{'r' * len(sheet.headings)}}}", r"\toprule", *body, r"\bottomrule"]
    return "\n".join([*head, *frame, r"\end{tabular}", r"\end{table}", ""])


def _plain(entry: Entry) -> str:
    return f"{entry.written.text()} ({entry.note})" if entry.note else entry.written.text()


def _tex(entry: Entry) -> str:
    return f"{entry.written.tex()} ({escape(entry.note)})" if entry.note else entry.written.tex()


def _note(table: Table, found: Sequence[Entry], words: Words) -> str:
    """Below a sheet: statistic, runs, unit, reading, and who failed."""
    if table.computed:
        return "Exact counts."
    statistics = " and ".join(distinct(entry.statistic for entry in found))
    runs = distinct(entry.runs for entry in found if entry.runs is not None)
    what = "repeats" if all(is_time(entry.metric) for entry in found) else "runs"
    over = f" over {' or '.join(map(str, runs))} {what}" if runs else ""
    metrics = distinct(entry.metric for entry in found)
    of = f" of {words.metric(metrics[0])}" if len(metrics) == 1 else ""
    parts = [f"{statistics.capitalize()}{of}{over} ± one standard error"]
    parts.append(f"unit: {table.unit}" if table.unit else "")
    parts.append("in italics: as printed in the paper" if any(entry.printed is not None for entry in found) else "")
    parts.append(f"reading: {found[0].reading}" if found[0].reading not in ("", "default") else "")
    sentences = ["; ".join(part for part in parts if part), casualties(found, words)]
    return " ".join(f"{sentence}." for sentence in sentences if sentence)


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
        "metric": material.words.metric,
        "statistic": str,
    }
    for combination in product(*(values[each] for each in order)):
        cell: dict[str, str] = dict(zip(order, combination, strict=True))
        row = ", ".join(names[each](cell[each]) for each in rows if cell[each])
        column = ", ".join(names[each](cell[each]) for each in columns if cell[each])
        yield row, column, (cell["filter"], cell["case"], cell["metric"], cell["statistic"])


def _listed(dimensions: Any) -> list[str]:
    return [dimensions] if isinstance(dimensions, str) else list(dimensions or ())
