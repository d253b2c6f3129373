"""Files that are written whole or not at all, and the one dialect of CSV that every table of rkfbench uses.

A file appears under its name only when all of it is on the disk: it is written beside its place under a temporary name,
flushed, and then renamed. Killing the process at any moment leaves the old file or the new one, never a piece.
CSV is UTF-8 with "\\n" line ends; a float is written by its `repr` and so reads back to the same bits; None is an empty
cell, so `nan` stands only where a computation gave NaN.
"""

from __future__ import annotations

import csv
import hashlib
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import IO, Any

from rkfbench.errors import UsageError

TEMPORARY = ".{name}.{pid}.tmp"
LONGEST = 80  # bytes of a label in a file's name

# Columns whose cells are names even when they look like numbers: a case may be called "5".
TEXT = frozenset(("reading", "case", "filter", "metric", "label", "name", "id", "claim"))


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the operating system's refusals (no permission, disk full, not a folder) into one message for the user."""
    try:
        yield
    except OSError as error:
        place = Path(error.filename) if isinstance(error.filename, str) else path
        raise UsageError(
            f"cannot write {place}: {error.strerror or error}\n"
            "what was finished is kept: mend this, or choose another folder, and run the same command again"
        ) from error


def slug(text: str) -> str:
    """A label as a part of a file's name; `data` where nothing is left of it."""
    return shortened(re.sub(r"[^\w.=,+-]+", "-", text).strip("-") or "data")


def shortened(name: str) -> str:
    """The name, with a hash of it in the place of what goes beyond 80 bytes: file systems take 255 in all."""
    whole = name.encode()
    if len(whole) <= LONGEST:
        return name
    return f"{whole[:LONGEST].decode(errors='ignore')}-{hashlib.sha256(whole).hexdigest()[:6]}"


@contextmanager
def atomic(path: Path) -> Iterator[IO[bytes]]:
    """A binary file that replaces `path` when the block ends without an exception, and vanishes otherwise."""
    temporary = path.with_name(TEMPORARY.format(name=path.name, pid=os.getpid()))
    with writing(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with open(temporary, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(temporary, path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        _sync_folder(path.parent)


def write(path: Path, content: bytes | str) -> None:
    """Write one file whole."""
    with atomic(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Write a table; `rows` may be a generator, so that a table may be larger than the memory."""
    with atomic(path) as file:
        out = csv.writer(_Encoder(file), lineterminator="\n")
        out.writerow(columns)
        out.writerows(rows)


def write_records(path: Path, columns: Sequence[str], records: Iterable[Mapping[str, Any]]) -> None:
    """Write a table of mappings; a missing key is an empty cell."""
    write_csv(path, columns, ([record.get(column) for column in columns] for record in records))


def read_csv(path: Path) -> tuple[list[str], Iterator[list[str]]]:
    """The columns of a table and its rows, one at a time, as text."""
    with path.open(encoding="utf-8", newline="") as file:
        columns = next(csv.reader(file), [])

    def rows() -> Iterator[list[str]]:
        with path.open(encoding="utf-8", newline="") as file:
            yield from islice(csv.reader(file), 1, None)

    return columns, rows()


def read_records(path: Path) -> list[dict[str, Any]]:
    """The rows of a table as mappings. Names are text; else what reads as a number is one, an empty cell is None."""
    columns, rows = read_csv(path)
    reads = [str if column in TEXT else value for column in columns]
    return [{column: read(cell) for column, read, cell in zip(columns, reads, row, strict=True)} for row in rows]


def value(text: str) -> Any:
    """The value that a cell of a table stands for: None, int, float or the text itself."""
    if text == "":
        return None
    number = int if text.lstrip("+-").isdecimal() else float  # asking first is much faster than failing first
    try:
        return number(text)
    except ValueError:
        return text


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hex."""
    with open(path, "rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files of a process that was killed while it wrote (call with the folder locked)."""
    name = TEMPORARY.format(name="*", pid="[0-9]*")
    links = [path for path in folder.iterdir() if path.is_symlink() and path.is_dir()]  # which rglob does not follow
    for temporary in [*folder.rglob(name), *(path for link in links for path in link.glob(name))]:
        temporary.unlink(missing_ok=True)


class _Encoder:
    """What `csv.writer` needs of a text file, on top of a binary one."""

    def __init__(self, file: IO[bytes]) -> None:
        self.file = file

    def write(self, text: str) -> int:
        return self.file.write(text.encode())


def _sync_folder(folder: Path) -> None:
    """Bring a rename to the disk; without this a power cut may undo it."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
