"""Tuning runs: the same cases with a seed of their own, on which the best of several filters is chosen.

What is chosen there is judged on the study's own runs, so a choice never profits from the runs that judge it. The
tuning runs are a small study inside the results folder, with only the candidates and only the metric of the choice.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rkfbench.errors import UsageError
from rkfbench.store import manifest
from rkfbench.store.manifest import TUNING
from rkfbench.study.engines import Engine
from rkfbench.study.events import Report
from rkfbench.study.run import Outcome, run_study

if TYPE_CHECKING:
    from rkfbench.scenario import Cell, Scenario

SEED_STEP = 1_000_003  # from the seed of the study to that of its tuning runs


@dataclass(frozen=True)
class Choice:
    """Filters to choose from, by label, and the metric to choose by."""

    candidates: tuple[str, ...]
    metric: str


def update(
    scenario: Scenario, choices: Collection[Choice], folder: Path, *, fresh: bool, engine: Engine, report: Report
) -> Outcome:
    """Bring the tuning runs below `folder` up to date."""
    study = study_of(scenario, choices)
    return run_study(study, folder / TUNING, full=True, fresh=fresh, engine=engine, report=report)


def tie(folder: Path, chosen: bool) -> None:
    """Seal a folder together with its tuning runs, if a choice is made on them: those of another study, of which there
    may be some, do not belong to it.
    """
    belonging = manifest.digest(folder / TUNING) if chosen else ""
    if manifest.read(folder)["hashes"].get(TUNING, "") != belonging:
        manifest.seal(folder, hashes={TUNING: belonging})


def study_of(scenario: Scenario, choices: Collection[Choice]) -> Scenario:
    """The study of the tuning runs: the candidates and the metrics of the choices, on a seed of its own.

    Raises UsageError for recorded data, which has no other runs.
    """
    if any(cell.spec.get("data") for cell in scenario.cells):
        raise UsageError(f"{scenario.name}: a best filter is chosen on tuning runs, and recorded data has none")
    labels = {label for choice in choices for label in choice.candidates}
    metrics = sorted({choice.metric for choice in choices})

    def narrowed(cell: Cell) -> Cell:
        filters = [each for each in cell.spec["filters"] if each["label"] in labels]
        return replace(cell, spec={**cell.spec, "filters": filters, "metrics": metrics})

    cells = tuple(narrowed(cell) for cell in scenario.cells)
    return replace(scenario, seed=scenario.seed + SEED_STEP, cells=cells, sensitivity=())
