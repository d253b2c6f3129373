"""Which computing times a study shows, and where they are kept: in timings/, apart from all that is byte-compared.

`timings/repeats.csv` has every single measurement, `timings/times.csv` their statistics in the columns of summary.csv
(a run is a repeat). Clock values are measured once for a state of the code, one after the other in the process of the
command, before anything else of it runs. They belong to the first reading, because a
reading changes numbers, not the work.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rkfbench.scenario import estimates
from rkfbench.store import files, manifest
from rkfbench.study import plan
from rkfbench.study.summary import summarise
from rkfbench.times import is_time

if TYPE_CHECKING:
    from rkfbench.claims.estimand import Estimand
    from rkfbench.scenario import Cell, Scenario

FILES = ("timings/repeats.csv", "timings/times.csv")
IDENTITY = ("reading", "case", "filter", "metric")
STATISTICS = ("runs", "failed", "lost", "mean", "se", "sd", "median", "q05", "q95", "max", "least")

Wanted = Mapping[str, set[str]]  # case -> labels of filters


@dataclass(frozen=True)
class Times:
    """Repeats (reading, case, filter, metric) -> values, and a digest of what they were made from."""

    made_from: str
    values: Mapping[tuple[str, ...], list[float]]


def measured(
    scenario: Scenario,
    wanted: Wanted,
    folder: Path,
    *,
    full: bool,
    fresh: bool = False,
) -> Times | None:
    """The times that are wanted; None when there are none, or the folder has them from the same code and filters."""
    from rkfbench.study.timing import measure

    jobs = [(cell, labels) for cell in _cells(scenario, full) if (labels := _labels(cell, wanted, full))]
    made_from = plan.digest([plan.code_hash(), _code_of_timing(), full, [[cell.spec, labels] for cell, labels in jobs]])
    if not jobs or (manifest.made_from(folder, "times", made_from, *FILES) and not fresh):
        return None
    values: dict[tuple[str, ...], list[float]] = {}
    for cell, labels in jobs:
        for time in measure(cell.spec, scenario.seed, labels, full=full):
            values.setdefault((cell.reading, cell.case, time.filter, time.metric), []).append(time.value)
    return Times(made_from, values)


def _code_of_timing() -> str:
    here = Path(__file__).parent
    return plan.hash_files(here, [here / "timing.py"])


def write(times: Times, folder: Path) -> None:
    """Write both files of a results folder."""
    repeats = ([*key, repeat, each] for key, found in times.values.items() for repeat, each in enumerate(found))
    files.write_csv(folder / FILES[0], [*IDENTITY, "repeat", "value"], repeats)
    rows = (dict(zip(IDENTITY, key, strict=True)) | _statistics(found) for key, found in times.values.items())
    files.write_records(folder / FILES[1], [*IDENTITY, *STATISTICS], rows)
    manifest.seal(folder, *FILES, hashes={"times": times.made_from})


def wanted(scenario: Scenario, estimands: Iterable[Estimand]) -> Wanted:
    """The times that tables show and claims are about: for each case the labels of filters."""
    from rkfbench.scenario.display import case_matches, metrics_in

    found: dict[str, set[str]] = {cell.case: set() for cell in scenario.cells}
    for table in scenario.tables:
        for cell in scenario.cells:
            if table.cases is None:
                shown = not cell.extra
            else:
                shown = any(case_matches(name, cell.case) for name in table.cases)
            if shown and any(is_time(name) for metric in table.metrics for name in metrics_in(metric)):
                found[cell.case] |= set(table.filters or plan.labels(cell, full=False))
    for point in (point for estimand in estimands if estimand.timing for point in estimand.points):
        for case in point.case.names():
            found.setdefault(case, set()).update(point.filter.names())
    return found


def _cells(scenario: Scenario, full: bool) -> list[Cell]:
    cells = [cell for cell in plan.cells(scenario, full) if cell.switch is None]
    return [cell for cell in cells if cell.reading == cells[0].reading]


def _labels(cell: Cell, wanted: Wanted, full: bool) -> list[str]:
    ours = (each for each in cell.spec["filters"] if not estimates.within(each))  # made elsewhere
    of_tier = [each["label"] for each in ours if full or not each.get("extra")]
    return [label for label in of_tier if label in wanted.get(cell.case, ())]


def _statistics(values: list[float]) -> dict[str, object]:
    rows = summarise(np.array(values), np.zeros(len(values), bool))
    return {"runs": len(values), "failed": 0, "lost": 0, **rows, "least": min(values)}
