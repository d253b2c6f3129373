"""Engines: ways to get jobs done. An engine takes jobs and yields what became of each, in any order.

The numbers do not depend on the engine: a job is a pure function of plain data. BLAS runs on one thread everywhere,
see `rkfbench.blas`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from rkfbench.pool import Pool
from rkfbench.study.jobs import Done, Job, work

Engine = Callable[[Sequence[Job]], Iterator[Done]]


def engine(jobs: int | None, pool: Pool) -> Engine:
    """The engine for `--jobs N` and its pool: 1 is serial, None decides by measuring."""
    if pool.workers == 1:
        return serial
    return partial(automatic if jobs is None else processes, pool=pool)


def serial(jobs: Sequence[Job]) -> Iterator[Done]:
    """One job after the other, in this process."""
    return map(work, jobs)


def automatic(jobs: Sequence[Job], pool: Pool) -> Iterator[Done]:
    """Begin in this process; hand the rest to the pool as soon as the time measured so far says that it pays."""
    begin = time.perf_counter()
    for done, job in enumerate(jobs):
        mean = (time.perf_counter() - begin) / max(done, 1)
        rest = len(jobs) - done
        if rest > 1 and pool.pays(mean * rest):
            yield from processes(jobs[done:], pool)
            return
        yield work(job)


def processes(jobs: Sequence[Job], pool: Pool) -> Iterator[Done]:
    """The processes of a pool."""
    return pool.unordered(work, jobs)
