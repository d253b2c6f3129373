"""How the work of a study is packed into jobs: cases side by side in one, filters and cases apart where cores wait.

No number depends on it. Few large jobs cost least in total; many small ones keep many cores busy.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, TypeVar

from rkfbench.streams import GROUP
from rkfbench.study import plan
from rkfbench.study.jobs import Job

if TYPE_CHECKING:
    from rkfbench.study.plan import Unit

A_WORKER = 2  # jobs for each worker, at least, so that none waits long for the last one
T = TypeVar("T")


def packed(wanted: Sequence[tuple[Unit, tuple[str, ...]]], seed: int, runs: int) -> list[Job]:
    """Jobs for units with the labels wanted of them: the same block of like cases together, within the memory of one
    full block.
    """
    from rkfbench.study.blocks import block_size
    from rkfbench.study.wide import structure

    alike: dict[tuple[str, ...], list[int]] = {}
    structures: dict[int, str] = {}
    for i, (unit, labels) in enumerate(wanted):
        spec = unit.cell.spec
        if id(spec) not in structures:
            structures[id(spec)] = plan.digest(structure(spec))
        key = structures[id(spec)], plan.reading(unit.cell), str(unit.block), *labels
        alike.setdefault(key, []).append(i)
    jobs = []
    for units in alike.values():
        first, labels = wanted[units[0]]
        width = -(-(first.last - first.first) // GROUP) * GROUP
        most = max(1, block_size(first.cell.spec["steps"]) // width)
        for start in range(0, len(units), most):
            some = tuple(units[start : start + most])
            specs = tuple(wanted[i][0].cell.spec for i in some)
            jobs.append(Job(some, specs, seed, first.block, runs, labels))
    return sorted(jobs, key=lambda job: job.units)


def divided(jobs: Sequence[Job], workers: int) -> list[Job]:
    """The jobs cut into smaller ones if they are too few for `workers`: between filters that share no work, then
    between filters that could share some, then between cases. No more than needed: every piece simulates its runs anew.
    """
    pieces = list(jobs)
    for cut in (_unrelated, _related, _cases):
        count = -(-A_WORKER * workers // max(len(pieces), 1))
        if count > 1:
            pieces = [piece for job in pieces for piece in cut(job, count)]
    return pieces


def _unrelated(job: Job, count: int) -> Iterator[Job]:
    return _filters(job, count, partners=True)


def _related(job: Job, count: int) -> Iterator[Job]:
    return _filters(job, count, partners=False)


def _filters(job: Job, count: int, partners: bool) -> Iterator[Job]:
    """Filters apart. Those that take a few runs at a time, often the dearest, are not mixed with others: their cases
    together save some of the work, but keep fewer cores busy. Neither are those that take one case after the other
    anyhow, and their cases are apart, too.
    """
    from rkfbench.experiment import Experiment
    from rkfbench.study.compute import portioned, sharing
    from rkfbench.study.wide import apart

    experiment = Experiment.of(job.specs[0])
    groups = sharing(experiment, job.labels, partners)
    single = [group for group in groups if len(job.units) > 1 and apart(experiment, group)]
    dear = [group for group in groups if group not in single and portioned(experiment, group)]
    for group in dear:
        yield from _cases(job.of_labels(*group), max(1, count // 2))
    for some in _spread([group for group in groups if group not in single and group not in dear], count):
        yield job.of_labels(*(label for group in some for label in group))
    if single:
        yield from _cases(job.of_labels(*(label for group in single for label in group)), count)


def _cases(job: Job, count: int) -> Iterator[Job]:
    for some in _spread(range(len(job.units)), count):
        yield job.of_cases(some)


def _spread(items: Sequence[T], count: int) -> list[Sequence[T]]:
    """The items in at most `count` heaps."""
    count = min(count, len(items))
    return [items[i::count] for i in range(count)]


class Agenda:
    """Which job is next: one of each group of filters, to see what it costs, then the longest first."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._waiting: dict[tuple[str, ...], deque[Job]] = {}
        for job in sorted(jobs, key=lambda job: -len(job.units)):
            self._waiting.setdefault(job.labels, deque()).append(job)
        self._begun: set[tuple[str, ...]] = set()
        self._seconds: dict[tuple[str, ...], float] = {}

    def take(self) -> Job | None:
        """The next job; None when all are taken."""
        if not self._waiting:
            return None
        labels = max(self._waiting, key=self._urgency)
        job = self._waiting[labels].popleft()
        self._begun.add(labels)
        if not self._waiting[labels]:
            del self._waiting[labels]
        return job

    def learn(self, job: Job, seconds: float) -> None:
        """What a job cost."""
        self._seconds[job.labels] = seconds

    def _urgency(self, labels: tuple[str, ...]) -> tuple[bool, bool, float]:
        return labels not in self._begun, labels not in self._seconds, self._seconds.get(labels, 0.0)
