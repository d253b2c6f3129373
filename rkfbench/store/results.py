"""Reading a results folder: the one way by which claims, tables, figures and comparisons see numbers.

`Results.open` believes nothing: schema version and the hash of each data file are checked against the manifest first,
so a number that was edited by hand, cut short or written by another version is named and refused.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import UsageError
from rkfbench.store import files, manifest

Row = dict[str, Any]
Table = TypeVar("Table")
Series = tuple[str, str, str]  # reading, case, label of the filter
RUNS = "runs.csv"
KEYS = ("reading", "case", "run", "filter", "failed", "lost")  # leading columns of runs.csv
Read = dict[tuple[str, str], Any]  # name and hash of a file -> what was read of it

_shared: dict[Path, Read] = {}


@contextmanager
def read_once(folder: Path) -> Iterator[None]:
    """Meanwhile each file of a results folder is read once, whoever opens the folder, unless it changes."""
    read = _shared.setdefault(folder.absolute(), {})
    try:
        yield
    finally:
        _shared.pop(folder.absolute(), None)
        for key in [key for key in read if key[0] == RUNS]:  # by far the largest
            del read[key]


class Results:
    """The numbers of one scenario.

    Numbers per run are there only where runs.csv was kept (`has_runs`). A KeyError says: not computed, such as an
    extra that was not run.
    """

    def __init__(self, folder: Path, content: Mapping[str, Any]) -> None:
        self.folder = folder
        self.manifest = content
        self.scenario: str = content["scenario"]
        self.seed: int = content["seed"]
        self.runs: int = content["runs"]
        self.stopped: str = (content.get("precision") or {}).get("text", "")  # where --precision stopped, and why
        self.has_runs = RUNS in content["files"]
        self._read: Read = _shared.get(folder.absolute(), {})

    @classmethod
    def open(cls, folder: str | Path) -> Results:
        """The results in `folder`; UsageError naming the file that is missing, changed or of another schema."""
        folder = Path(folder)
        content = manifest.read(folder)
        manifest.verify(folder, content)
        return cls(folder, content)

    @cached_property
    def summary(self) -> list[Row]:
        """The rows of summary.csv."""
        return self._records("summary.csv")

    @cached_property
    def series(self) -> list[Row]:
        """The rows of series.csv."""
        return self._records("series.csv")

    @cached_property
    def filters(self) -> list[Row]:
        """The rows of filters.csv."""
        return self._records("filters.csv")

    @cached_property
    def claims(self) -> list[Row]:
        """The rows of claims.csv; [] when the scenario decides no claim."""
        return self._records("claims.csv")

    @cached_property
    def checks(self) -> dict[str, tuple[float, float]]:
        """Exact checks: id -> (deviation, tolerance)."""
        return {row["id"]: (float(row["deviation"]), float(row["tolerance"])) for row in self._records("checks.csv")}

    @cached_property
    def notes(self) -> dict[str, str]:
        """What exact checks say themselves of what they found: id -> a few words."""
        return {row["id"]: str(row["note"]) for row in self._records("checks.csv") if row.get("note")}

    @cached_property
    def timings(self) -> dict[str, list[Row]]:
        """Tables measured with a clock, by the name of the file in timings/ without its ending."""
        names = [name for name in self.manifest["files"] if name.startswith("timings/") and name.endswith(".csv")]
        return {Path(name).stem: self._records(name) for name in names}

    def values(self, reading: str, case: str, filter: str, metric: str) -> NDArray[np.float64]:
        """One metric of one filter for every run, (M,), NaN where it failed; of a time, one value a repeat."""
        if (case, filter, metric) in self._times:
            return np.array(self._times[case, filter, metric])
        return self._columns(reading, case, filter)[metric]

    def failed(self, reading: str, case: str, filter: str) -> NDArray[np.bool_]:
        """The runs in which the filter died numerically, (M,)."""
        return self._columns(reading, case, filter)["failed"].astype(bool)

    def lost(self, reading: str, case: str, filter: str) -> NDArray[np.bool_]:
        """The runs that meet the scenario's definition of a lost track, or failed, (M,)."""
        return self._columns(reading, case, filter)["lost"].astype(bool) | self.failed(reading, case, filter)

    def check(self, id: str) -> tuple[float, float]:
        """Deviation and tolerance of an exact check."""
        return self.checks[id]

    @cached_property
    def _times(self) -> dict[tuple[str, str, str], list[float]]:
        """The repeats of what was timed; readings change numbers, not times."""
        times: dict[tuple[str, str, str], list[float]] = {}
        for row in self.timings.get("repeats", ()):
            times.setdefault((row["case"], row["filter"], row["metric"]), []).append(row["value"])
        return times

    @cached_property
    def tuning(self) -> Results | None:
        """The results of the tuning runs that belong to these numbers; None where there are none, or others."""
        place = self.folder / manifest.TUNING
        belonging = self.manifest.get("hashes", {}).get(manifest.TUNING)
        return Results.open(place) if belonging and belonging == manifest.digest(place) else None

    def _columns(self, reading: str, case: str, filter: str) -> dict[str, NDArray[np.float64]]:
        if not self.has_runs:
            raise UsageError(f"{self.folder} keeps no numbers per run: use the folder of the run itself")
        return self._per_run[reading, case, filter]

    @property
    def _per_run(self) -> dict[Series, dict[str, NDArray[np.float64]]]:
        return self._once(RUNS, _numbers_per_run)

    def _records(self, name: str) -> list[Row]:
        return self._once(name, files.read_records) if name in self.manifest["files"] else []

    def _once(self, name: str, read: Callable[[Path], Table]) -> Table:
        key = name, self.manifest["files"][name]
        if key not in self._read:
            self._read[key] = read(self.folder / name)
        table: Table = self._read[key]
        return table


def _numbers_per_run(path: Path) -> dict[Series, dict[str, NDArray[np.float64]]]:
    columns, rows = files.read_csv(path)
    names = columns[columns.index("failed") :]
    first = len(columns) - len(names)
    # flat machine numbers, row after row: a list of Python floats would take eight times the memory
    numbers: dict[Series, array[float]] = {}
    for row in rows:
        key = (row[0], row[1], row[3])
        if key not in numbers:
            numbers[key] = array("d")
        cells = row[first:]
        numbers[key].extend(map(float, cells) if all(cells) else (float(text) if text else np.nan for text in cells))
    tables = {key: np.frombuffer(flat).reshape(-1, len(names)) for key, flat in numbers.items()}
    return {key: dict(zip(names, table.T, strict=True)) for key, table in tables.items()}
