"""Computing what a results folder does not hold: through an engine, each block written when its parts have arrived.

Whatever ends this early (Ctrl-C, a full disk, a killed process), the finished blocks stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import TYPE_CHECKING

from rkfbench import own
from rkfbench.store import blocks
from rkfbench.store.blocks import Part
from rkfbench.study import loops, plan
from rkfbench.study.deaths import Deaths
from rkfbench.study.engines import Engine
from rkfbench.study.events import BlockDone, CaseDone, Failure, Planned, Recomputing, Report
from rkfbench.study.packing import packed
from rkfbench.study.plan import Stored, Unit

if TYPE_CHECKING:
    from rkfbench.scenario import Scenario
    from rkfbench.study.jobs import Job

LONG = 1.0  # seconds of computing: such a part is written before its block is complete


def compute_missing(
    units: Sequence[Unit], scenario: Scenario, engine: Engine, report: Report
) -> tuple[int, tuple[Failure, ...]]:
    """Compute what the folder does not hold of these units: how many these were, and what failed."""
    stored = [plan.look_up(unit) for unit in units]
    wanted = [(unit, was) for unit, was in zip(units, stored, strict=True) if was.missing]
    report(Planned(len(wanted)))
    for reason in dict.fromkeys(was.reason for _, was in wanted if was.reason):
        cases = dict.fromkeys(plan.name(unit.cell) for unit, was in wanted if was.reason == reason)
        report(Recomputing(tuple(cases), reason))
    own.beside(scenario.plugins)
    for note in loops.notes(wanted):
        report(note)
    return len(wanted), tuple(_compute(wanted, scenario, engine, report))


def foreseen(units: Sequence[Unit], scenario: Scenario, fresh: bool) -> list[Job]:
    """The jobs of `compute_missing`, as the folder lets expect them (fresh: it will be empty); none where files of
    plug-ins may change meanwhile.
    """
    if any(unit.cell.spec.get("plugins") for unit in units):
        return []
    expected = ((unit, unit.labels if fresh else plan.look_up(unit).missing) for unit in units)
    return packed([(unit, missing) for unit, missing in expected if missing], scenario.seed, scenario.runs)


def _compute(
    wanted: Sequence[tuple[Unit, Stored]], scenario: Scenario, engine: Engine, report: Report
) -> Iterator[Failure]:
    """Get the missing parts through the engine. A block is written as soon as it is complete; what took long to
    compute, at once.
    """
    open_blocks: dict[str, int] = {}
    for unit, _ in wanted:
        open_blocks[plan.name(unit.cell)] = open_blocks.get(plan.name(unit.cell), 0) + 1
    drafts = {i: _Draft(unit, was) for i, (unit, was) in enumerate(wanted)}
    jobs = packed([(unit, was.missing) for unit, was in wanted], scenario.seed, scenario.runs)
    if not jobs:
        return
    deaths = Deaths()
    try:
        with closing(engine(jobs)) as arriving:  # ends what it has begun, whatever happens here
            for done in arriving:
                for (i, label), part in done.parts.items():
                    drafts[i].add(label, part)
                    deaths.add(i, plan.name(drafts[i].unit.cell), label, part)
                for (i, label), fault in done.faults.items():
                    unit = drafts[i].unit
                    drafts[i].add(label, None)
                    failure = Failure(plan.name(unit.cell), label, unit.block, fault.message, fault.traceback)
                    report(failure)
                    yield failure
                for i in dict.fromkeys(i for i, _ in done.places):
                    draft = drafts[i]
                    if not draft.missing or done.seconds > LONG:
                        draft.write()
                    if not draft.missing:
                        del drafts[i]
                        case = plan.name(draft.unit.cell)
                        report(BlockDone(case))
                        open_blocks[case] -= 1
                        if not open_blocks[case]:
                            report(CaseDone(case, scenario.runs, len(draft.unit.labels)))
    finally:
        for draft in drafts.values():
            draft.write()
    for died in deaths.told():
        report(died)


class _Draft:
    """A block on its way: parts arrive in any order and from several jobs."""

    def __init__(self, unit: Unit, was: Stored) -> None:
        self.unit = unit
        self.missing = set(was.missing)
        self._good = set(was.usable)  # what its file holds
        self._new: dict[str, Part] = {}

    def add(self, label: str, part: Part | None) -> None:
        """A part that has arrived; None: there will be none."""
        self.missing.discard(label)
        if part is not None:
            self._new[label] = part

    def write(self) -> None:
        """Write the new parts beside those of the file that are good."""
        if self._new:
            parts = (blocks.read(self.unit.path, self._good) if self._good else {}) | self._new
            blocks.write(self.unit.path, {label: (self.unit.keys[label], parts[label]) for label in sorted(parts)})
            self._good |= self._new.keys()
            self._new = {}
