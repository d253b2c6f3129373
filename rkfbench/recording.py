"""Recorded data in place of a simulation: measurements, and the true states where they are known, from CSV files.

    run,t,px,py            one row a step; `run` where there are several recordings, a time where a scenario names one
    a,0.5,1.02,0.97
    a,1.0,1.55,            an empty cell, or nan: this component is missing

A recording is one run. The file of the truth has the states as columns and the same rows. What else a file has in
columns is not looked at.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rkfbench import sheet
from rkfbench.errors import Problem
from rkfbench.linalg import Array
from rkfbench.sheet import Sheet, told

RUN = "run"  # the column that tells recordings apart
JITTER = 1e-3  # relative: time steps that differ by less are equal


@dataclass(frozen=True)
class Recording:
    """Measurements y (T, m, M) with NaN for what is missing, true states x (T, n, M) or None, times (T, M) or None."""

    y: Array
    x: Array | None
    times: Array | None

    @property
    def runs(self) -> int:
        return self.y.shape[2]

    @property
    def intervals(self) -> Array | None:
        """The time from each step to the next one, (T - 1, M)."""
        return None if self.times is None else np.diff(self.times, axis=0)

    def head(self, steps: int) -> Recording:
        """The first steps."""
        x, times = (None if each is None else each[:steps] for each in (self.x, self.times))
        return Recording(self.y[:steps], x, times)

    def block(self, first: int, width: int) -> tuple[Array, Array]:
        """Truth (NaN where it is not known) and measurements of `width` runs from `first` on; after the last one they
        begin anew, as filters work on whole groups of runs.
        """
        runs = (first + np.arange(width)) % self.runs
        x = np.full((len(self.y), 1, 1), np.nan) if self.x is None else self.x[..., runs]
        return x, self.y[..., runs]


def read(data: Mapping[str, Any], measurements: Sequence[str], states: Sequence[str]) -> Recording:
    """The recordings that the `data` of a scenario names, for a model with these measurements and states.

    Raises ScenarioError with the place in the CSV file of everything that is wrong: columns that are not there, text
    for numbers, times that do not increase, lengths that differ. InputChanged where a file is not the one of which
    `data` has the hash.
    """
    sha256 = data.get("sha256", {})
    page = sheet.read(data["measurements"], sha256.get("measurements", ""))
    time = data.get("time")
    faults = page.lacking(measurements, "the model measures")
    if time is not None:
        faults += page.lacking([time], "the scenario names as `time`")
    if faults:
        raise told(faults)
    groups = page.groups(_keys(page))
    y = page.numbers(measurements, faults)
    faults += _unequal(page, groups)
    times = None if time is None else _times(page, time, groups, faults)
    if faults:
        raise told(faults)
    x = None
    if data.get("truth") is not None:
        x = _truth(sheet.read(data["truth"], sha256.get("truth", "")), states, time, page, groups, times)
    shape = len(groups), -1
    return Recording(
        _runs_last(y, len(groups)),
        None if x is None else _runs_last(x, len(groups)),
        None if times is None else times.reshape(shape).T,
    )


def size(data: Mapping[str, Any]) -> tuple[int, int]:
    """Runs and steps of the recordings, without a look at their numbers."""
    page = sheet.read(data["measurements"])
    groups = page.groups(_keys(page))
    return len(groups), min(rows.stop - rows.start for rows in groups.values())


def _keys(page: Sheet) -> list[str]:
    return [RUN] if RUN in page.columns else []


def _runs_last(table: Array, runs: int) -> Array:
    """(M T, d) -> (T, d, M)."""
    return np.ascontiguousarray(table.reshape(runs, -1, table.shape[1]).transpose(1, 2, 0))


def _unequal(page: Sheet, groups: Mapping[tuple[str, ...], slice]) -> list[Problem]:
    """Runs that are not as long as the first one."""
    (first, rows), *others = groups.items()
    steps = rows.stop - rows.start
    return [
        page.fault(
            f"run {key[0]} has {each.stop - each.start} steps, run {first[0]} has {steps}: "
            "fill what is missing with rows of empty cells",
            each.stop - 1,
            RUN,
        )
        for key, each in others
        if each.stop - each.start != steps
    ]


def _times(page: Sheet, column: str, groups: Mapping[tuple[str, ...], slice], faults: list[Problem]) -> Array:
    before = len(faults)
    times = page.numbers([column], faults)[:, 0]
    if len(faults) > before:
        return times
    for rows in groups.values():
        for i in range(rows.start, rows.stop):
            if np.isnan(times[i]):
                faults.append(page.fault("the time is missing", i, column))
            elif i > rows.start and times[i] <= times[i - 1]:
                faults.append(page.fault(f"the time does not increase: {times[i]:g} after {times[i - 1]:g}", i, column))
    return times


def _truth(
    page: Sheet,
    states: Sequence[str],
    time: str | None,
    measured: Sheet,
    groups: Mapping[tuple[str, ...], slice],
    times: Array | None,
) -> Array:
    """The true states of the same runs and steps, (M T, n)."""
    faults = page.lacking(states, "the model has as a state")
    if RUN in measured.columns:
        faults += page.lacking([RUN], f"{measured.file} has")
    if faults:
        raise told(faults)
    own = page.groups(_keys(page))
    if RUN in measured.columns and list(own) != list(groups):
        i = next((rows.start for key, rows in own.items() if key not in groups), 0)
        raise told([page.fault(f"the runs are not those of {measured.file}, in the same order", i, RUN)])
    for theirs, rows in zip(groups.values(), own.values(), strict=True):
        if rows.stop - rows.start != theirs.stop - theirs.start:
            length, wanted = rows.stop - rows.start, theirs.stop - theirs.start
            faults.append(page.fault(f"{length} steps, {measured.file} has {wanted}", rows.stop - 1))
    if faults:
        raise told(faults)
    x = page.numbers(states, faults)
    if faults:
        raise told(faults)
    faults += (page.fault("the truth is missing", int(i), states[j]) for i, j in np.argwhere(np.isnan(x)))
    if times is not None and time in page.columns:
        own_times = page.numbers([time], faults)[:, 0]
        apart = np.flatnonzero(~(np.abs(own_times - times) <= 1e-9 * np.maximum(1.0, np.abs(times))))
        faults += (page.fault(f"not the time of {measured.file}, {times[i]:g}", int(i), time) for i in apart)
    if faults:
        raise told(faults)
    return x
