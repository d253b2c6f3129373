"""One piece of work of a study: some filters on one block of runs of some cases, from plain data to small arrays.

A job travels to another process or machine as it is, and what comes back is small: numbers per run, and curves already
reduced to their moments. A filter that raises takes no other filter with it.
"""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from rkfbench.errors import InputChanged
from rkfbench.own.faults import told
from rkfbench.store.blocks import Array, Curve, Part

if TYPE_CHECKING:
    from rkfbench.study.compute import FilterResult

Place = tuple[int, str]  # number of a case's unit, as whoever made the job counts them, and label of a filter


@dataclass(frozen=True)
class Job:
    """Filters `labels` on block `block` of the `runs` runs of the cases that `specs` describes (plain data).

    Cases of one job have `wide.structure` in common. `units` are their numbers.
    """

    units: tuple[int, ...]
    specs: tuple[Mapping[str, Any], ...]
    seed: int
    block: int
    runs: int
    labels: tuple[str, ...]

    @property
    def size(self) -> int:
        """How many parts it makes: filters times cases."""
        return len(self.units) * len(self.labels)

    def of_labels(self, *labels: str) -> Job:
        """The same with fewer filters."""
        return replace(self, labels=labels)

    def of_cases(self, places: Sequence[int]) -> Job:
        """The same with fewer cases."""
        units, specs = tuple(self.units[i] for i in places), tuple(self.specs[i] for i in places)
        return replace(self, units=units, specs=specs)

    def singles(self) -> Iterator[Job]:
        """Each filter in each case alone."""
        for label in self.labels:
            for i in range(len(self.units)):
                yield self.of_labels(label).of_cases([i])


@dataclass(frozen=True)
class Fault:
    """An exception of one filter: what the user reads, and the traceback behind it."""

    message: str
    traceback: str


@dataclass(frozen=True)
class Done:
    """What became of a job, or of one of its filters: for each place a part or a fault. And the seconds it took."""

    parts: Mapping[Place, Part]
    faults: Mapping[Place, Fault]
    seconds: float = 0.0

    @property
    def places(self) -> list[Place]:
        return [*self.parts, *self.faults]


def work(job: Job) -> Done:
    """Compute a job."""
    begin = time.perf_counter()
    every = list(stream(job))
    parts = {place: part for done in every for place, part in done.parts.items()}
    faults = {place: fault for done in every for place, fault in done.faults.items()}
    return Done(parts, faults, time.perf_counter() - begin)


def stream(job: Job) -> Iterator[Done]:
    """Compute a job, one filter in all its cases after the other.

    When one raises, what is left is taken one filter of one case at a time, to keep those that do work; a warning tells
    when they all do.
    """
    left = list(job.labels)
    begin = time.perf_counter()
    try:
        for label, parts in _parts(job):
            left.remove(label)
            now = time.perf_counter()
            yield Done({(unit, label): part for unit, part in zip(job.units, parts, strict=True)}, {}, now - begin)
            begin = time.perf_counter()
        return
    except InputChanged:  # no filter's fault: nothing more of this study can be computed
        raise
    except (Exception, SystemExit) as error:  # a plug-in ends no study
        reason = error
        if job.size == 1:
            fault = Fault(told(error), traceback.format_exc())
            yield Done({}, {(job.units[0], job.labels[0]): fault}, time.perf_counter() - begin)
            return
    faulty = False
    for label in left:
        singles = [work(single) for single in job.of_labels(label).singles()]
        yield Done(
            {place: part for done in singles for place, part in done.parts.items()},
            {place: fault for done in singles for place, fault in done.faults.items()},
            sum(done.seconds for done in singles),
        )
        faulty = faulty or any(done.faults for done in singles)
    if not faulty:
        warnings.warn(f"computed one at a time, which works but is slow; together: {told(reason)}", stacklevel=1)


def _parts(job: Job) -> Iterator[tuple[str, list[Part]]]:
    """Filter after filter its part in every case."""
    from rkfbench import metrics
    from rkfbench.study.compute import together

    def curve(spec: Mapping[str, Any], metric: str, paths: Array, failed: Array) -> Curve:
        return Curve.of(metrics.get(metric).ks(spec["steps"])[: len(paths)], paths, failed)

    def part(spec: Mapping[str, Any], of: FilterResult) -> Part:
        curves = {metric: curve(spec, metric, paths, of.failed) for metric, paths in of.curves.items()}
        return Part(of.failed, of.lost, of.values, curves, of.death)

    for label, results in together(job.specs, job.seed, job.block, job.runs, job.labels):
        yield label, [part(spec, result) for spec, result in zip(job.specs, results, strict=True)]
