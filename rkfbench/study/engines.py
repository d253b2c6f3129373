"""Engines: ways to get jobs done. An engine takes jobs and yields what became of each, in any order.

The numbers do not depend on the engine: a job is a pure function of plain data. BLAS runs on one thread everywhere,
see `rkfbench.blas`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial

from rkfbench.pool import Pool
from rkfbench.study.jobs import Done, Job, stream, work
from rkfbench.study.packing import Agenda, divided

Engine = Callable[[Sequence[Job]], Generator[Done]]  # whoever stops before its end closes it


def engine(jobs: int | None, pool: Pool, scheduler: str | None = None) -> Engine:
    """The engine for `--jobs N` with its pool (1: serial, None: measuring decides), or for `--scheduler ADDRESS`."""
    if scheduler is not None:
        from rkfbench.study.cluster import local, remote

        return partial(local, workers=pool.workers) if scheduler == "local" else partial(remote, address=scheduler)
    if pool.workers == 1:
        return serial
    return partial(automatic if jobs is None else processes, pool=pool)


def serial(jobs: Sequence[Job]) -> Generator[Done]:
    """One job after the other, in this process."""
    for job in jobs:
        yield from stream(job)


def automatic(jobs: Sequence[Job], pool: Pool) -> Generator[Done]:
    """Begin in this process; hand the rest to the pool as soon as the time measured so far says that it pays."""
    if pool.pays(0):  # its processes are there already
        yield from processes(jobs, pool)
        return
    begin = time.perf_counter()
    finished, total = 0, sum(job.size for job in jobs)
    for i, job in enumerate(jobs):
        left = list(job.labels)
        for done in stream(job):
            yield done
            left.remove(done.places[0][1])
            finished += len(done.places)
            if pool.pays((time.perf_counter() - begin) / finished * (total - finished)):
                rest = [job.of_labels(*left)] if left else []
                yield from processes([*rest, *jobs[i + 1 :]], pool)
                return


def processes(jobs: Sequence[Job], pool: Pool) -> Generator[Done]:
    """The processes of a pool, the longest jobs first."""
    agenda = _agenda(jobs, pool)
    for job, done in pool.fed(work, agenda.take):
        agenda.learn(job, done.seconds)
        yield done


def in_order(jobs: Sequence[Job], pool: Pool) -> Iterator[Job]:
    """The jobs as `processes` will ask for them, as far as that is known before any of them is done."""
    return iter(_agenda(jobs, pool).take, None)


def _agenda(jobs: Sequence[Job], pool: Pool) -> Agenda:
    return Agenda(divided(jobs, pool.workers))
