"""Engines: ways to get jobs done. An engine takes jobs and yields what became of each, in any order.

The numbers do not depend on the engine: a job is a pure function of plain data. BLAS runs on one thread everywhere,
see `rkfbench.blas`.
"""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

from rkfbench import blas
from rkfbench.errors import RkfbenchError
from rkfbench.study.jobs import Done, Job, work

Engine = Callable[[Sequence[Job]], Generator[Done]]  # whoever stops before its end closes it

START_UP = 3.0  # seconds of work that make starting worker processes worth their start-up


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def engine(jobs: int | None) -> Engine:
    """The engine for `--jobs N`: 1 is serial, None decides by measuring."""
    if jobs is None:
        return automatic if cores() > 1 else serial
    return serial if jobs == 1 else partial(processes, workers=jobs)


def serial(jobs: Sequence[Job]) -> Generator[Done]:
    """One job after the other, in this process."""
    yield from map(work, jobs)


def automatic(jobs: Sequence[Job]) -> Generator[Done]:
    """Begin in this process; hand the rest to all cores as soon as the time measured so far says that it pays."""
    begin = time.perf_counter()
    for done, job in enumerate(jobs, start=1):
        yield work(job)
        rest = len(jobs) - done
        if rest > 1 and (time.perf_counter() - begin) / done * rest > START_UP:
            yield from processes(jobs[done:], workers=cores())
            return


def processes(jobs: Sequence[Job], workers: int) -> Generator[Done]:
    """`workers` processes on this machine (started by spawn: no state is inherited)."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed
    from concurrent.futures.process import BrokenProcessPool

    blas.one_thread()
    pool = ProcessPoolExecutor(
        min(workers, len(jobs)) or 1, mp_context=multiprocessing.get_context("spawn"), initializer=_serve
    )
    try:
        with _interrupts_held():  # submitting starts the workers
            futures = [pool.submit(work, job) for job in jobs]
        for future in as_completed(futures):
            yield future.result()
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


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """A Ctrl-C that comes now is answered afterwards. Processes started here hold theirs too, until they `_serve`:
    Ctrl-C reaches every process of a terminal, and one that is still importing would answer with a traceback.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _serve() -> None:
    """In a worker: leave Ctrl-C to the driver, and end with the driver, however that ends."""
    import multiprocessing

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    driver = multiprocessing.parent_process()

    def follow() -> None:
        if driver is not None:
            driver.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
