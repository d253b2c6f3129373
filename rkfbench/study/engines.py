"""Engines: ways to get jobs done. An engine takes jobs and yields what became of each, in any order.

The numbers do not depend on the engine: a job is a pure function of plain data. BLAS runs on one thread everywhere,
see `rkfbench.blas`.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, cast

from rkfbench import blas
from rkfbench.errors import RkfbenchError
from rkfbench.study.jobs import Done, Job, stream, work
from rkfbench.study.packing import Agenda, divided

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

Engine = Callable[[Sequence[Job]], Iterator[Done]]

START_UP = 3.0  # seconds of work that make starting worker processes worth their start-up


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
    """`workers` processes on this machine (started by spawn: no state is inherited), each with a pipe of its own, so
    that the end of one, at any moment, is seen and hurts no other.
    """
    import multiprocessing
    from multiprocessing.connection import wait

    blas.one_thread()
    context = multiprocessing.get_context("spawn")
    jobs = divided(jobs, workers)
    agenda = Agenda(jobs)
    team: dict[Connection, BaseProcess] = {}
    busy: dict[Connection, Job] = {}

    def next_for(pipe: Connection) -> None:
        if job := agenda.take():
            busy[pipe] = job
            pipe.send(job)

    try:
        with deaf():
            for _ in range(min(workers, len(jobs))):
                ours, theirs = context.Pipe()
                process = context.Process(target=_serve, args=(theirs,))
                process.start()
                theirs.close()
                team[ours] = process
        try:
            for pipe in team:
                next_for(pipe)
            while busy:
                for ready in wait(list(busy)):
                    pipe = cast("Connection", ready)
                    done: Done = pipe.recv()
                    agenda.learn(busy.pop(pipe), done.seconds)
                    next_for(pipe)
                    yield done
        except (EOFError, ConnectionError) as error:
            raise RkfbenchError(
                "a worker process was killed (out of memory?); finished blocks are kept: run the same command again, "
                "with fewer --jobs if memory was short"
            ) from error
    finally:
        for member in team.values():
            member.terminate()
        for pipe, member in team.items():
            member.join()
            pipe.close()


def _serve(pipe: Connection) -> None:
    """Compute the jobs that come through a pipe until it is closed at the other end."""
    try:
        while True:
            pipe.send(work(pipe.recv()))
    except (EOFError, ConnectionError):
        return


@contextmanager
def deaf() -> Iterator[None]:
    """What is started here never hears Ctrl-C, which reaches every process of a terminal: only the driver answers it,
    when this has ended.
    """
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start, which the first process would be the occasion for, unblocks signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
