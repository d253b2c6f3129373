"""Estimates that another program made: a CSV file in the place of a filter.

    case,run,k,px,py,vx,vy,P_px_px,P_px_py, ...      run = 0, 1, ..; k = 1 .. T; `case` where there are several

The columns of the covariance are those of its upper triangle, P_a_b for states a and b in their order; without them
there is no covariance. A run has failed from the first step on at which a cell is empty or nan.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from rkfbench import sheet
from rkfbench.filters.base import Estimate, Known
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.sheet import Sheet, told
from rkfbench.streams import GROUP, Streams

PLACE = ("reading", "case")  # columns that say to which cell a row belongs
KEYS = ("run", "k")


@dataclass(frozen=True)
class Estimates:
    """Estimates read from a CSV file: columns run, k, the states, case where there are several; P_a_b for covariances.

    `case`, `reading` and `sha256` are filled in by the scenario: of each cell the rows that are about it, and of the
    file the hash, so that no other file is read in its place.
    """

    file: Annotated[str, "the CSV file, as seen from the scenario file"]
    case: Annotated[str, "the case whose rows are read"] = ""
    reading: Annotated[str, "the reading whose rows are read"] = ""
    sha256: Annotated[str, "SHA-256 of the file"] = ""

    sees = frozenset({"cov"})

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The estimates of the runs of the streams (from the first one on without any); P is NaN where there is none.

        After the last run of the file they begin anew: filters work on whole groups of runs.
        """
        page = sheet.read(self.file, self.sha256)
        place = {"case": self.case, "reading": self.reading}
        mean, cov = table(page, place, model.states, y.shape[0])
        runs = (GROUP * (streams.first if streams else 0) + np.arange(y.shape[2])) % mean.shape[2]
        mean, cov = mean[..., runs], cov if cov.shape[-1] == 1 else cov[..., runs]
        failed = (~np.isfinite(mean).all(1) | np.isinf(y).any(1)).cumsum(0) > 0
        mean = np.where(failed[:, None], np.nan, mean)
        return Estimate(mean, cov if "cov" in keep else None, failed[-1])


def table(page: Sheet, place: Mapping[str, str], states: Sequence[str], steps: int) -> tuple[Array, Array]:
    """Means (T, n, M) and covariances (T, n, n, M or 1) of one cell.

    Raises ScenarioError with the place in the file of what is wrong: columns or rows that are not there, text for
    numbers.
    """
    pairs = [(a, b) for i, a in enumerate(states) for b in states[i:]]
    wanted = [covariance_column(*pair) for pair in pairs]
    given = [name for name in wanted if name in page.columns]
    faults = page.lacking([*KEYS, *states], "is needed")
    if given:
        faults += page.lacking(wanted, f"goes with {given[0]}")
    if faults:
        raise told(faults)
    rows = page.groups(keys := [key for key in PLACE if key in page.columns])[tuple(place[key] for key in keys)]
    index = page.numbers(KEYS, faults, rows)
    if faults:
        raise told(faults)
    count = rows.stop - rows.start
    where = np.arange(count)
    expected = np.column_stack([where // steps, where % steps + 1])
    wrong = np.flatnonzero((index != expected).any(1))
    if len(wrong):
        i = int(wrong[0])
        run, k = expected[i]
        found = ", ".join(f"{key} {value:g}" for key, value in zip(KEYS, index[i], strict=True))
        raise told([page.fault(f"run {run}, k {k} is expected here, not {found}", rows.start + i, "k")])
    if count % steps:
        raise told([page.fault(f"run {count // steps} ends at k = {count % steps}, not {steps}", rows.stop - 1, "k")])
    numbers = page.numbers([*states, *given], faults, rows)
    if faults:
        raise told(faults)
    values = numbers.reshape(-1, steps, numbers.shape[1]).transpose(1, 2, 0)
    n = len(states)
    cov = np.full((steps, n, n, 1), np.nan)
    if given:
        cov = np.empty((steps, n, n, values.shape[2]))
        for (a, b), column in zip(pairs, np.moveaxis(values[:, n:], 1, 0), strict=True):
            i, j = states.index(a), states.index(b)
            cov[:, i, j] = cov[:, j, i] = column
    return np.ascontiguousarray(values[:, :n]), cov


def covariance_column(a: str, b: str) -> str:
    """The column of the covariance of two states."""
    return f"P_{a}_{b}"


def cells_of(page: Sheet) -> dict[tuple[str, ...], tuple[int, int]]:
    """For each combination of reading and case, of the columns that there are: its first row and number of runs."""
    groups = page.groups([key for key in PLACE if key in page.columns])
    if faults := page.lacking(["run"], "is needed"):
        raise told(faults)
    runs = page.texts("run")
    return {key: (rows.start, len(set(runs[rows]))) for key, rows in groups.items()}


def runs_of(file: str | Path) -> int:
    """The runs that a file has of every cell that it is about."""
    return min(count for _, count in cells_of(sheet.read(file)).values())
