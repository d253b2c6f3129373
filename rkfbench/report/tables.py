"""Tables: the entries laid out in rows and columns, one sheet a reading, and written down as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from rkfbench.report.captions import averaged, casualties
from rkfbench.report.entries import Entry
from rkfbench.report.material import distinct, is_timing
from rkfbench.report.numbers import as_printed, fixed, written
from rkfbench.report.words import PLAIN, Words
from rkfbench.scenario.display import Table


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


def markdown(table: Table, sheets: Sequence[Sheet], level: int = 1) -> str:
    """The sheets as Markdown tables; the paper's numbers in lines of their own."""
    parts = [f"{'#' * level} {title(table)}", *([table.caption] if table.caption else [])]
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


def title(table: Table) -> str:
    """What stands above a table: its title, else its id in words."""
    return table.title or (table.id[:1].upper() + table.id[1:]).replace("_", " ")


def _plain(entry: Entry) -> str:
    return f"{entry.written.text()} ({entry.note})" if entry.note else entry.written.text()


def _over(found: Sequence[Entry]) -> str:
    """` over 3000 runs and 10 repeats of a time`."""
    counted = {
        what: distinct(each.runs for each in found if each.runs is not None and is_timing(each.metric) == timed)
        for what, timed in (("runs", False), ("repeats of a time", True))
    }
    told = [f"{' or '.join(map(str, numbers))} {what}" for what, numbers in counted.items() if numbers]
    return f" over {' and '.join(told)}" if told else ""


def _note(table: Table, found: Sequence[Entry], words: Words) -> str:
    """Below a sheet: statistic, runs, unit, reading with its caveat, and who failed."""
    if table.computed:
        return "Exact counts."
    statistics, metrics = distinct(entry.statistic for entry in found), distinct(entry.metric for entry in found)
    error = " ± one standard error" if statistics != ["max"] else ""
    error += " (of a max: none)" if error and "max" in statistics else ""
    parts = [f"{averaged(statistics, metrics, words, name=len(metrics) == 1)}{_over(found)}{error}"]
    parts.append(f"unit: {table.unit}" if table.unit else "")
    parts.append("in italics: as printed in the paper" if any(entry.printed is not None for entry in found) else "")
    told = casualties(found, words, statistics)
    sentences = ["; ".join(part for part in parts if part), words.reading(found[0].reading), told]
    return " ".join(f"{sentence.rstrip('.')}." for sentence in sentences if sentence)
