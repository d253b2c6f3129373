"""Engines: ways to get jobs done. An engine takes jobs and yields what became of each, in any order.

The numbers do not depend on the engine: a job is a pure function of plain data. BLAS runs on one thread everywhere,
see `rkfbench.blas`.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from rkfbench import blas
from rkfbench.errors import RkfbenchError
from rkfbench.study.jobs import Done, Job, stream, work
from rkfbench.study.packing import Agenda, divided

Engine = Callable[[Sequence[Job]], Iterator[Done]]

START_UP = 3.0  # seconds of work that make starting worker processes worth their start-up
AHEAD = 2  # jobs for each worker that are on their way: one computed, one waiting beside it


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def engine(jobs: int | None, scheduler: str | None = None) -> Engine:
    """The engine for `--jobs N` and `--scheduler ADDRESS`: 1 is serial, None decides by measuring."""
    if scheduler is not None:
        from rkfbench.study.cluster import local, remote

        return partial(local, workers=jobs or cores()) if scheduler == "local" else partial(remote, address=scheduler)
    if jobs is None:
        return automatic if cores() > 1 else serial
    return serial if jobs == 1 else partial(processes, workers=jobs)


def serial(jobs: Sequence[Job]) -> Iterator[Done]:
    """One job after the other, in this process."""
    for job in jobs:
        yield from stream(job)


def automatic(jobs: Sequence[Job]) -> Iterator[Done]:
    """Begin in this process; hand the rest to all cores as soon as the time measured so far says that it pays."""
    begin = time.perf_counter()
    finished, total = 0, sum(job.size for job in jobs)
    for i, job in enumerate(jobs):
        left = list(job.labels)
        for done in stream(job):
            yield done
            left.remove(done.places[0][1])
            finished += len(done.places)
            if (time.perf_counter() - begin) / finished * (total - finished) > START_UP:
                rest = [job.of_labels(*left)] if left else []
                yield from processes([*rest, *jobs[i + 1 :]], workers=cores())
                return


def processes(jobs: Sequence[Job], workers: int) -> Iterator[Done]:
    """`workers` processes on this machine (started by spawn: no state is inherited)."""
    import multiprocessing
    from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
    from concurrent.futures.process import BrokenProcessPool

    blas.one_thread()
    jobs = divided(jobs, workers)
    agenda = Agenda(jobs)
    pool = ProcessPoolExecutor(
        min(workers, len(jobs)) or 1, mp_context=multiprocessing.get_context("spawn"), initializer=_ignore_interrupts
    )
    running: dict[Future[Done], Job] = {}
    try:
        while True:
            while len(running) < AHEAD * workers and (job := agenda.take()):
                running[pool.submit(work, job)] = job
            if not running:
                break
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                done = future.result()
                agenda.learn(running.pop(future), done.seconds)
                yield done
    except BrokenProcessPool as error:
        raise RkfbenchError(
            "a worker process was killed (out of memory?); finished blocks are kept: run the same command again, "
            "with fewer --jobs if memory was short"
        ) from error
    except BaseException:
        children = multiprocessing.active_children()
        pool.shutdown(wait=False, cancel_futures=True)
        for child in children:
            child.terminate()
        raise
    pool.shutdown()


def _ignore_interrupts() -> None:
    """Ctrl-C reaches every process of a terminal; only the driver answers it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
