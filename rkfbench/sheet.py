"""CSV files of others, read with the place of every fault: recordings, and estimates of filters written elsewhere.

Every row is one step of one run. A fault is told with file, line and column, all faults of a file at once.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import sys
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from rkfbench.errors import InputChanged, Problem, ScenarioError, UsageError, did_you_mean
from rkfbench.linalg import Array

MOST_TOLD = 8  # faults of one file
BUFFER = 1 << 16  # bytes read at a time
MISSING = frozenset(("", "NA"))  # and what reads as nan
KEYS = ("reading", "case", "run")  # columns that say what a row is about: text, even where they look like numbers


@dataclass(frozen=True)
class Sheet:
    """A CSV file: for every column its numbers, for the columns in KEYS their text too. Row i stands in line
    `lines[i]`.
    """

    path: Path
    file: str
    columns: tuple[str, ...]
    lines: array[int]
    _numbers: Mapping[str, Array] = field(repr=False)  # NaN for what is missing, infinite for no number
    _texts: Mapping[str, list[str]] = field(repr=False)
    _wrong: Mapping[str, Mapping[int, str]] = field(repr=False)  # column -> row -> what is no finite number
    sha256: str = ""  # of the bytes that were read

    def fault(self, message: str, row: int | None = None, column: str = "") -> Problem:
        """A fault at a cell; without a row in the header."""
        line = 1 if row is None else self.lines[row]
        with self.path.open(encoding="utf-8-sig", newline=None) as file:
            source = next(islice(file, line - 1, None), "").rstrip("\n")
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
        """The cells of one of the columns in KEYS."""
        return self._texts[column]

    def numbers(self, columns: Sequence[str], faults: list[Problem], rows: slice = slice(None)) -> Array:
        """(rows, columns) as numbers, NaN where a cell is empty or says nan; what is no finite number is a fault."""
        first, last, _ = rows.indices(len(self.lines))
        for name in columns:
            wrong = ((i, cell) for i, cell in self._wrong[name].items() if first <= i < last)
            faults += (self.fault(f"'{cell}' is no finite number", i, name) for i, cell in islice(wrong, MOST_TOLD + 1))
        return np.column_stack([self._numbers[name][rows] for name in columns])

    def groups(self, keys: Sequence[str]) -> dict[tuple[str, ...], slice]:
        """The rows of each combination of the columns `keys`, which stand together; ScenarioError where they do not."""
        columns = [self.texts(key) for key in keys]
        of_row: list[tuple[str, ...]] = list(zip(*columns, strict=True)) if columns else [()] * len(self.lines)
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
    last = [Problem(faults[0].file, 0, 0, "", "and more of the kind")] if len(faults) > MOST_TOLD else []
    return ScenarioError([*faults[:MOST_TOLD], *last])


def read(path: str | Path, sha256: str = "") -> Sheet:
    """The sheet that a CSV file holds: a header of distinct names, and rows of as many cells.

    Raises UsageError for what cannot be read, ScenarioError with the place of each fault in it. With the hash of the
    file that is meant: InputChanged for any other.
    """
    path = Path(path)
    try:
        stat = path.stat()
        page = _read(path, stat.st_mtime_ns, stat.st_size)
    except (OSError, UsageError) as error:
        if sha256:
            raise InputChanged(_shown(path)) from None
        if isinstance(error, UsageError):
            raise
        raise UsageError(f"{_shown(path)}: {(error.strerror or str(error)).lower()}") from None
    if sha256 not in ("", page.sha256):
        raise InputChanged(_shown(path))
    return page


def content(path: str | Path, sha256: str) -> bytes:
    """The bytes of a file; InputChanged where it has not this hash ("": where it is not there)."""
    try:
        found = Path(path).read_bytes()
    except OSError:
        raise InputChanged(_shown(Path(path))) from None
    if sha256 not in ("", hashlib.sha256(found).hexdigest()):
        raise InputChanged(_shown(Path(path)))
    return found


@lru_cache(maxsize=8)
def _read(path: Path, *stamp: int) -> Sheet:
    shown = _shown(path)
    try:
        with path.open("rb", buffering=0) as file:
            hashed = _Hashed(file)
            text = io.TextIOWrapper(io.BufferedReader(hashed, BUFFER), encoding="utf-8-sig", newline="")
            page = _parsed(path, shown, csv.reader(text))
            return replace(page, sha256=hashed.hash.hexdigest())
    except OSError as error:
        raise UsageError(f"{shown}: {(error.strerror or str(error)).lower()}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{shown}: not UTF-8 text") from None


class _Hashed(io.RawIOBase):
    """A file that is hashed while it is read, so that the hash is that of what was read."""

    def __init__(self, file: io.FileIO) -> None:
        self.file = file
        self.hash = hashlib.sha256()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        count = self.file.readinto(buffer) or 0
        self.hash.update(memoryview(buffer)[:count])
        return count


def _parsed(path: Path, shown: str, reader: Any) -> Sheet:
    columns = tuple(cell.strip() for cell in next(reader, ()))
    page = Sheet(path, shown, columns, array("l"), {}, {}, {})
    if len(columns) == 1 and ";" in columns[0]:
        raise told([page.fault("the cells must be separated by commas")])
    if twice := [name for i, name in enumerate(columns) if name in columns[:i]]:
        raise told([page.fault(f"two columns are called '{name}'") for name in twice])
    numbers: dict[str, array[float]] = {name: array("d") for name in columns}
    texts: dict[str, list[str]] = {name: [] for name in columns if name in KEYS}
    wrong: dict[str, dict[int, str]] = {name: {} for name in columns}
    faults: list[Problem] = []
    try:
        for row in filter(None, reader):
            page.lines.append(reader.line_num)
            if len(row) != len(columns):
                message = f"{len(row)} cells, the header has {len(columns)}"
                faults.append(page.fault(message, len(page.lines) - 1))
                if len(faults) > MOST_TOLD:
                    break
                continue
            for name, cell in zip(columns, row, strict=True):
                value = _number(cell)
                if math.isinf(value):
                    wrong[name][len(page.lines) - 1] = cell.strip()
                numbers[name].append(value)
                if name in texts:
                    texts[name].append(sys.intern(cell.strip()))
    except csv.Error as error:
        faults.append(Problem(shown, reader.line_num, 1, "", str(error)))
    if faults:
        raise told(faults)
    if not page.lines:
        raise UsageError(f"{shown}: has no rows: a header and one row a step are expected")
    arrays = {name: np.frombuffer(column) for name, column in numbers.items()}
    return Sheet(path, shown, columns, page.lines, arrays, texts, wrong)


def _number(cell: str) -> float:
    """The number in a cell: NaN where it is missing, infinity where it is none."""
    try:
        return float(cell)
    except ValueError:
        return math.nan if cell.strip() in MISSING else math.inf


def _shown(path: Path) -> str:
    """The path as messages show it: seen from the current directory when it is inside."""
    full, here = path.absolute(), Path.cwd()
    return full.relative_to(here).as_posix() if full.is_relative_to(here) else str(path)
