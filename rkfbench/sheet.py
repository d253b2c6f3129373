"""CSV files of others, read with the place of every fault: recordings, and estimates of filters written elsewhere.

Every row is one step of one run. A fault is told with file, line and column, all faults of a file at once.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np

from rkfbench.errors import Problem, ScenarioError, UsageError, did_you_mean
from rkfbench.linalg import Array

MOST_TOLD = 8  # faults of one file
MISSING = frozenset(("", "nan", "NaN", "NAN", "NA"))


@dataclass(frozen=True)
class Sheet:
    """The cells of a CSV file as text; row i stands in line `lines[i]` of the file."""

    file: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    _source: tuple[str, ...] = field(repr=False)

    def fault(self, message: str, row: int | None = None, column: str = "") -> Problem:
        """A fault at a cell; without a row in the header."""
        line = 1 if row is None else self.lines[row]
        source = self._source[line - 1]
        before = source.split(",")[: self.columns.index(column)] if column in self.columns else []
        return Problem(self.file, line, sum(len(cell) + 1 for cell in before) + 1, column, message, source)

    def lacking(self, names: Sequence[str], what: str) -> list[Problem]:
        """The columns `names` that are not there; `what` says whose they are."""
        there = f" (there are {', '.join(self.columns)})"
        return [
            self.fault(f"no column '{name}', which {what}{did_you_mean(name, self.columns) or there}")
            for name in names
            if name not in self.columns
        ]

    def texts(self, column: str) -> list[str]:
        """The cells of a column."""
        place = self.columns.index(column)
        return [row[place] for row in self.rows]

    def numbers(self, columns: Sequence[str], faults: list[Problem], rows: slice = slice(None)) -> Array:
        """(rows, columns) as numbers, NaN where a cell is empty or says nan; what is no finite number is a fault."""
        table = np.full((len(self.rows[rows]), len(columns)), np.nan)
        for j, name in enumerate(columns):
            cells = ["nan" if cell in MISSING else cell for cell in self.texts(name)[rows]]
            try:
                table[:, j] = cells
                unsound = np.flatnonzero(np.isinf(table[:, j])).tolist()
            except ValueError:
                unsound = [i for i, cell in enumerate(cells) if not _finite(cell)]
            start = rows.start or 0
            faults += (self.fault(f"'{cells[i]}' is no finite number", start + i, name) for i in unsound)
        return table

    def groups(self, keys: Sequence[str]) -> dict[tuple[str, ...], slice]:
        """The rows of each combination of the columns `keys`, which stand together; ScenarioError where they do not."""
        columns = [self.texts(key) for key in keys]
        of_row = list(zip(*columns, strict=True)) if columns else [()] * len(self.rows)
        starts = [i for i, key in enumerate(of_row) if i == 0 or key != of_row[i - 1]]
        found: dict[tuple[str, ...], slice] = {}
        for start, stop in zip(starts, [*starts[1:], len(of_row)], strict=True):
            if of_row[start] in found:
                named = " ".join(f"{key} {value}" for key, value in zip(keys, of_row[start], strict=True))
                raise told([self.fault(f"{named} stands in two places: its rows must follow each other", start)])
            found[of_row[start]] = slice(start, stop)
        return found


def told(faults: Sequence[Problem]) -> ScenarioError:
    """The error that tells these faults, the first ones if there are many."""
    more = len(faults) - MOST_TOLD
    last = [Problem(faults[0].file, 0, 0, "", f"and {more} more faults")] if more > 0 else []
    return ScenarioError([*faults[:MOST_TOLD], *last])


def read(path: str | Path) -> Sheet:
    """The sheet that a CSV file holds: a header of distinct names, and rows of as many cells.

    Raises UsageError for what cannot be read, ScenarioError with the place of each fault in it.
    """
    path = Path(path)
    try:
        stat = path.stat()
    except OSError as error:
        raise UsageError(f"{_shown(path)}: {(error.strerror or str(error)).lower()}") from None
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=8)
def _read(path: Path, *stamp: int) -> Sheet:
    shown = _shown(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise UsageError(f"{shown}: {(error.strerror or str(error)).lower()}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{shown}: not UTF-8 text") from None
    source = tuple(text.splitlines())
    reader = csv.reader(source)
    columns: tuple[str, ...] = ()
    rows, lines = [], []
    faults: list[Problem] = []
    try:
        for cells in reader:
            row = tuple(cell.strip() for cell in cells)
            if not any(row) and len(row) <= 1:
                continue
            if not columns:
                columns = row
            elif len(row) != len(columns):
                faults.append(_at(shown, source, reader.line_num, f"{len(row)} cells, the header has {len(columns)}"))
            else:
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        faults.append(_at(shown, source, reader.line_num, str(error)))
    if not rows and not faults:
        raise UsageError(f"{shown}: has no rows: a header and one row a step are expected")
    if len(columns) == 1 and ";" in columns[0]:
        faults = [_at(shown, source, 1, "the cells must be separated by commas")]
    faults += (_at(shown, source, 1, f"two columns are called '{name}'") for name in _twice(columns))
    if faults:
        raise told(faults)
    return Sheet(shown, columns, tuple(rows), tuple(lines), source)


def _shown(path: Path) -> str:
    """The path as messages show it: seen from the current directory when it is inside."""
    full, here = path.absolute(), Path.cwd()
    return full.relative_to(here).as_posix() if full.is_relative_to(here) else str(path)


def _at(file: str, source: Sequence[str], line: int, message: str) -> Problem:
    return Problem(file, line, 1, "", message, source[line - 1] if 0 < line <= len(source) else "")


def _twice(names: Sequence[str]) -> list[str]:
    return [name for i, name in enumerate(names) if name in names[:i]]


def _finite(cell: str) -> bool:
    try:
        return cell in MISSING or not np.isinf(float(cell))
    except ValueError:
        return False
