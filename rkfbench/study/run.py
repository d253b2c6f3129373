"""Run a study: find what the folder already holds, compute the rest, write each block as it arrives, then the tables.

Nothing here prints: what happens is told to a callback as small events. Whatever ends a run early (Ctrl-C, a full disk,
a killed process), the finished blocks stay and the same call goes on from there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rkfbench.errors import RkfbenchError, UsageError
from rkfbench.store import blocks, files, manifest
from rkfbench.store.lock import locked
from rkfbench.study import plan
from rkfbench.study.engines import Engine, serial
from rkfbench.study.events import BlockDone, CaseDone, Failure, Planned, Recomputing, Report, Spoiled
from rkfbench.study.jobs import Done, Job
from rkfbench.study.plan import Stored, Unit

if TYPE_CHECKING:
    from rkfbench.scenario import Scenario

# What is made from the tables of a study, and so is out of date when they change.
DERIVED = ("claims.csv", "claims.md", "tables", "figures", "report.md", "report.html")


@dataclass(frozen=True)
class Outcome:
    """What a run did: blocks in which something was computed, whether any file changed, and what raised."""

    folder: Path
    computed: int
    reused: int
    changed: bool
    failures: tuple[Failure, ...]
    seconds: float


def run_study(
    scenario: Scenario,
    folder: Path,
    *,
    full: bool = False,
    fresh: bool = False,
    engine: Engine = serial,
    report: Report = lambda event: None,
    facts: Mapping[str, Any] | None = None,
) -> Outcome:
    """Bring the numbers in `folder` up to date with `scenario`.

    full: extras and sensitivity too. fresh: compute everything anew. facts: more entries for the manifest (argv).
    Raises UsageError when the folder is in use by another run, holds something else, or cannot be written.
    """
    with reserved(folder, scenario.name):
        return update(scenario, folder, full=full, fresh=fresh, engine=engine, report=report, facts=facts)


def update(
    scenario: Scenario,
    folder: Path,
    *,
    full: bool = False,
    fresh: bool = False,
    engine: Engine = serial,
    report: Report = lambda event: None,
    facts: Mapping[str, Any] | None = None,
) -> Outcome:
    """The same in a folder that is `reserved`."""
    begin, started = time.perf_counter(), _now()
    if fresh:
        _remove(folder / manifest.BLOCKS)
    units = list(plan.units(scenario, folder, full))
    stored = [plan.look_up(unit) for unit in units]
    wanted = [(unit, was) for unit, was in zip(units, stored, strict=True) if was.missing]
    report(Planned(len({id(unit.cell) for unit in units}), len(units), len(wanted)))
    for reason in dict.fromkeys(was.reason for _, was in wanted if was.reason):
        cases = dict.fromkeys(plan.name(unit.cell) for unit, was in wanted if was.reason == reason)
        report(Recomputing(tuple(cases), reason))

    failures = tuple(_compute(wanted, scenario, engine, report))
    seconds = time.perf_counter() - begin
    if spoiled := manifest.spoiled(folder):
        report(Spoiled(tuple(spoiled)))
        for name in spoiled:  # made again: the tables below, the others by those who make them
            _remove(folder / name)
    times = {"started": started, "seconds": round(seconds, 3)}
    changed = _write_tables(folder, scenario, units, failures, full, {**(facts or {}), **times})
    return Outcome(folder, len(wanted), len(units) - len(wanted), changed, failures, seconds)


@contextmanager
def reserved(folder: Path, name: str) -> Iterator[None]:
    """Hold `folder` for a run of the scenario `name`; UsageError when another run has it, or it is something else."""
    _refuse_foreign(folder, name)
    with locked(folder):
        yield


def _compute(
    wanted: Sequence[tuple[Unit, Stored]], scenario: Scenario, engine: Engine, report: Report
) -> Iterator[Failure]:
    """Get the missing parts through the engine; each block is written as it arrives."""
    jobs = [
        Job(index, unit.cell.spec, scenario.seed, unit.block, scenario.runs, was.missing)
        for index, (unit, was) in enumerate(wanted)
    ]
    open_blocks: dict[str, int] = {}
    for unit, _ in wanted:
        open_blocks[plan.name(unit.cell)] = open_blocks.get(plan.name(unit.cell), 0) + 1
    if not jobs:
        return
    with closing(engine(jobs)) as arriving:  # ends its processes, whatever happens here
        for done in arriving:
            unit, was = wanted[done.index]
            case = plan.name(unit.cell)
            _keep(unit, was, done)
            for label, fault in done.faults.items():
                failure = Failure(case, label, unit.block, fault.message, fault.traceback)
                report(failure)
                yield failure
            report(BlockDone(case, unit.block, unit.last - unit.first))
            open_blocks[case] -= 1
            if not open_blocks[case]:
                report(CaseDone(case, scenario.runs, len(unit.labels)))


def _keep(unit: Unit, was: Stored, done: Done) -> None:
    """Write the new parts of a block beside those of the old ones that are still good."""
    parts = blocks.read(unit.path, set(was.usable)) if was.usable else {}
    parts |= done.parts
    if parts:
        blocks.write(unit.path, {label: (unit.keys[label], part) for label, part in parts.items()})


def _write_tables(
    folder: Path,
    scenario: Scenario,
    units: Sequence[Unit],
    failures: Sequence[Failure],
    full: bool,
    facts: Mapping[str, Any],
) -> bool:
    """Write and seal the tables, unless the folder already holds those of exactly these parts."""
    from rkfbench.study import outputs

    missing = {(failure.case, failure.filter) for failure in failures}
    finished = []
    for _, group in groupby(units, key=lambda unit: id(unit.cell)):
        of_cell = tuple(group)
        cell = of_cell[0].cell
        labels = tuple(label for label in of_cell[0].labels if (plan.name(cell), label) not in missing)
        if labels:
            finished.append(outputs.Finished(cell, of_cell, labels))
    parts = [[unit.keys[label] for label in unit.labels] for unit in units]
    hashes = {"plan": plan.digest([scenario.resolved, parts, sorted(missing)]), "code": plan.code_hash()}
    if _up_to_date(folder, hashes):
        return False
    for name in DERIVED:  # they speak of the old numbers
        _remove(folder / name)
    outputs.write(folder, scenario, finished)
    return manifest.seal(
        folder,
        scenario=scenario.name,
        title=scenario.title,
        paper=scenario.paper,
        seed=scenario.seed,
        runs=scenario.runs,
        full=full,
        curve_median_runs=max((unit.last for unit in units if unit.block == 0), default=0),
        incomplete=[f"{case}: {label}" for case, label in sorted(missing)],
        **manifest.machine(),
        **facts,
        finished=_now(),
        hashes=hashes,
    )


def _up_to_date(folder: Path, hashes: Mapping[str, str]) -> bool:
    return not manifest.spoiled(folder) and all(manifest.made_from(folder, *each) for each in hashes.items())


def _refuse_foreign(folder: Path, name: str) -> None:
    """Results go into a new or empty folder, or over results of the same scenario: never over anything else."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file: choose another folder with --out")
    with files.writing(folder):
        entries = {path.name for path in folder.iterdir() if not path.name.startswith(".")}
    if manifest.NAME in entries:
        try:
            other = manifest.read(folder)["scenario"]
        except (RkfbenchError, KeyError):
            return  # a results folder that is damaged, or of another schema: made again
        if other != name:
            raise UsageError(f"{folder} holds the results of '{other}': choose another folder with --out")
    elif entries and manifest.BLOCKS not in entries:  # with blocks alone it is a run that was cut short
        raise UsageError(f"{folder} holds other files: choose an empty folder, or a new one, with --out")


def _remove(path: Path) -> None:
    with files.writing(path):
        if path.is_dir() and not path.is_symlink():
            for inner in path.iterdir():
                _remove(inner)
            path.rmdir()
        else:
            path.unlink(missing_ok=True)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
