"""Run a study: find what the folder already holds, compute the rest, write each block as it arrives, then the tables.

Nothing here prints: what happens is told to a callback as small events. Whatever ends a run early (Ctrl-C, a full disk,
a killed process), the finished blocks stay and the same call goes on from there.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rkfbench.store import blocks, manifest, place
from rkfbench.store.lock import locked, shared
from rkfbench.study import plan
from rkfbench.study.engines import Engine, serial
from rkfbench.study.events import CaseDone, Failure, Report, Spoiled, Stopped
from rkfbench.study.missing import compute_missing
from rkfbench.study.plan import Unit

if TYPE_CHECKING:
    from rkfbench.scenario import Scenario
    from rkfbench.study.precision import Goal, Settled
    from rkfbench.study.shards import Shard

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
    runs: int
    open: int = 0  # after a shard: blocks of the study that nobody has finished yet


@dataclass(frozen=True)
class Computed:
    """The blocks of a study, as far as no filter raised; `write` makes the tables of them."""

    scenario: Scenario  # with as many runs as it took
    folder: Path
    units: Sequence[Unit]
    new: int  # of the units, in which something was computed
    failures: tuple[Failure, ...]
    seconds: float
    full: bool
    facts: Mapping[str, Any]  # for the manifest

    def write(self) -> Outcome:
        """Write and seal the tables, unless the folder already holds those of exactly these parts."""
        changed = _write_tables(self.folder, self.scenario, self.units, self.failures, self.full, self.facts)
        return self.outcome(changed)

    def outcome(self, changed: bool = False) -> Outcome:
        """What was done, the tables apart."""
        reused = len(self.units) - self.new
        return Outcome(self.folder, self.new, reused, changed, self.failures, self.seconds, self.scenario.runs)


def run_study(
    scenario: Scenario,
    folder: Path,
    *,
    full: bool = False,
    fresh: bool = False,
    engine: Engine = serial,
    report: Report = lambda event: None,
    facts: Mapping[str, Any] | None = None,
    goal: Goal | None = None,
) -> Outcome:
    """Bring the numbers in `folder` up to date with `scenario`.

    full: extras and sensitivity too. fresh: compute everything anew. facts: more entries for the manifest (argv).
    goal: as many runs as it takes, in the place of the scenario's number.
    Raises UsageError when the folder is in use by another run, holds something else, or cannot be written.
    """
    with reserved(folder, scenario.name):
        return compute(
            scenario, folder, full=full, fresh=fresh, engine=engine, report=report, facts=facts, goal=goal
        ).write()


def compute(
    scenario: Scenario,
    folder: Path,
    *,
    full: bool = False,
    fresh: bool = False,
    engine: Engine = serial,
    report: Report = lambda event: None,
    facts: Mapping[str, Any] | None = None,
    goal: Goal | None = None,
) -> Computed:
    """The same in a folder that is `reserved`, but for the tables."""
    begin, started = time.perf_counter(), _now()
    place.mark(folder, scenario.name)
    if fresh:
        place.remove_blocks(folder)
    settled = None
    if goal is None:
        units, computed, failures = _bring(scenario, folder, full, engine, report)
    else:
        scenario, settled, units, computed, failures = _until_precise(scenario, folder, full, engine, report, goal)
    seconds = time.perf_counter() - begin
    if spoiled := [name for name in manifest.spoiled(folder) if not _is_read(scenario, folder / name)]:
        report(Spoiled(tuple(spoiled)))
        place.remove(folder, spoiled)  # made again: the tables below, the others by those who make them
    times = {"started": started, "seconds": round(seconds, 3)}
    more = {**(facts or {}), **times, "precision": settled and settled.facts()}
    return Computed(scenario, folder, units, computed, failures, seconds, full, more)


def compute_shard(
    scenario: Scenario,
    folder: Path,
    shard: Shard,
    *,
    full: bool = False,
    engine: Engine = serial,
    report: Report = lambda event: None,
) -> Outcome:
    """Compute the blocks of one shard, beside others that do the same with theirs; no table is written."""
    place.refuse_foreign(folder, scenario.name)
    with shared(folder):
        place.mark(folder, scenario.name)
        begin = time.perf_counter()
        units = list(plan.units(scenario, folder, full))
        its_own = [unit for i, unit in enumerate(units) if shard.has(i)]
        computed, failures = compute_missing(its_own, scenario, engine, _but_cases(report))
        left = sum(bool(plan.look_up(unit).missing) for unit in units)
        seconds = time.perf_counter() - begin
    return Outcome(folder, computed, len(its_own) - computed, False, failures, seconds, scenario.runs, left)


def _but_cases(report: Report) -> Report:
    """A shard finishes blocks, but no case."""
    return lambda event: None if isinstance(event, CaseDone) else report(event)


@contextmanager
def reserved(folder: Path, name: str) -> Iterator[None]:
    """Hold `folder` for a run of the scenario `name`; UsageError when another run has it, or it is something else."""
    place.refuse_foreign(folder, name)
    with locked(folder):
        yield


def _bring(
    scenario: Scenario, folder: Path, full: bool, engine: Engine, report: Report
) -> tuple[list[Unit], int, tuple[Failure, ...]]:
    """All units of a study, how many of them had to be computed, and what failed in them."""
    units = list(plan.units(scenario, folder, full))
    return units, *compute_missing(units, scenario, engine, report)


def _until_precise(
    scenario: Scenario, folder: Path, full: bool, engine: Engine, report: Report, goal: Goal
) -> tuple[Scenario, Settled | None, list[Unit], int, tuple[Failure, ...]]:
    """The same with as many runs as the goal takes; the scenario with that number, and where it was found."""
    from rkfbench.study.blocks import block_size
    from rkfbench.study.precision import Search

    search = Search(goal, max(block_size(cell.spec["steps"]) for cell in plan.cells(scenario, full)))
    computed = 0
    while True:
        runs = search.ahead() if search.settled is None else search.settled.runs
        resolved = {**scenario.resolved, "runs": {"paper": runs, "reference": runs}}
        scenario = replace(scenario, runs=runs, resolved=resolved)
        units, more, failures = _bring(scenario, folder, full, engine, report)
        computed += more
        if failures:
            return scenario, None, units, computed, failures
        search.look(units, runs)
        if search.settled is not None and search.settled.runs == runs:
            report(Stopped(str(search.settled)))
            return scenario, search.settled, units, computed, ()


def _write_tables(
    folder: Path,
    scenario: Scenario,
    units: Sequence[Unit],
    failures: Sequence[Failure],
    full: bool,
    facts: Mapping[str, Any],
) -> bool:
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
    stored = [blocks.digest(unit.path) for unit in units]  # the same key may have given other numbers
    made_from = [scenario.resolved, parts, stored, sorted(missing), facts["precision"]]
    hashes = {
        "plan": plan.digest(made_from),
        "code": plan.code_hash(),
        plan.EXPERIMENT: plan.experiment(scenario),
    }
    if _up_to_date(folder, hashes):
        return False
    held, before = outputs.Held.of(scenario), manifest.listed(folder)  # before anything goes away
    place.remove(folder, [name for name in before if name.split("/")[0] in DERIVED])  # they speak of the old numbers
    written = outputs.write(folder, held, scenario, finished)
    place.remove(folder, [name for name in before if name.split("/")[0] in outputs.COPIES and name not in written])
    return manifest.seal(
        folder,
        *written,
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


def _is_read(scenario: Scenario, path: Path) -> bool:
    """Whether the scenario was read from this file or reads it: it may be the one that the folder itself keeps."""
    from rkfbench.scenario import attached

    _, read = attached.carried(scenario.resolved)
    return path.resolve() in {Path(each).resolve() for each in (scenario.file, *read.values())}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
