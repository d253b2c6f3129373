"""The worker processes of one command: started when they are first wanted, and kept for all that it gives them to do.

They are spawned, so that no state is inherited, and run BLAS on one thread. What they do is a pure function of plain
data, so that nothing depends on their number.
"""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from rkfbench import blas, stderr
from rkfbench.errors import RkfbenchError
from rkfbench.interrupts import held

if TYPE_CHECKING:
    from concurrent.futures import Future, ProcessPoolExecutor

Item = TypeVar("Item")
Result = TypeVar("Result")

START_UP = 3.0  # seconds of work that make starting worker processes worth their start-up
COLLECT = 100_000  # new objects, before a process looks for garbage: modules and tables, which are most of all, stay
SETTLE = 0.01  # seconds in which a process that is up leaves work to the others
AHEAD = 2  # items for each worker that are on their way: one computed, one waiting beside it


def cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Pool:
    """At most `workers` processes (`None`: one a core); with one, all is done in this process.

    Leaving the `with` block ends them: at once when an exception leaves it.
    """

    def __init__(self, workers: int | None = None) -> None:
        self.workers = cores() if workers is None else workers
        self._processes: ProcessPoolExecutor | None = None
        self._starting = threading.Lock()
        self._coming: Callable[[], Iterable[Any]] = tuple
        self._early: list[tuple[Any, Any, Future[Any]]] = []  # function, item and what becomes of it
        self._modules: Sequence[str] = ()
        self._up: list[Future[int]] = []
        self._closing: threading.Thread | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._processes is None:
            return
        import multiprocessing

        children, results = multiprocessing.active_children(), self._processes._result_queue
        if self._closing is None:
            self._processes.shutdown(wait=kind is None, cancel_futures=True)
        elif kind is None:  # one shutdown is enough: a second one may meet what the first has closed
            self._closing.join()
        if kind is not None:
            for child in children:
                child.terminate()
            for child in children:
                child.join()
            # who was reading a result that ended in the middle now meets its end instead of waiting for the rest
            results._writer.close()  # type: ignore[attr-defined]

    def start(self, *modules: str) -> None:
        """Start the processes for work that is sure to come, and let them import what it needs."""
        if self.workers > 1:
            self._up = [self._begun(_import, modules) for _ in range(self.workers)]
            self._modules = modules

    def started(self) -> None:
        """Wait until all processes that were told to `start` have done so, and leave the machine alone."""
        up: set[int] = set()
        with told():
            while self._up:
                up |= {future.result() for future in self._up}
                left = self.workers - len(up)  # one that is up may have taken what was meant for another
                self._up = [self._begun(_import, self._modules) for _ in range(self.workers)] if left else []

    def close(self) -> None:
        """No more work comes: the processes end meanwhile, for which leaving the `with` block will wait."""
        if self._processes is not None:
            self._closing = threading.Thread(target=self._processes.shutdown)
            self._closing.start()

    def pays(self, seconds: float) -> bool:
        """Whether so many seconds of work in several pieces are better given to the processes than done here."""
        return self.workers > 1 and (self._processes is not None or seconds > START_UP)

    def ordered(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[Result]:
        """function(item) of each item, in their order; all are handed over at once."""
        with told():
            for future in [self.submit(function, item) for item in items]:
                yield future.result()

    def foresee(self, items: Callable[[], Iterable[Any]]) -> None:
        """What will be wanted after the next `fed`, of which it begins the first where it leaves processes idle."""
        self._coming = items

    def fed(self, function: Callable[[Item], Result], take: Callable[[], Item | None]) -> Iterator[tuple[Item, Result]]:
        """Each item that `take` gives, until it gives None, with its function(item) as soon as that is there; an item
        is taken only when it would not wait for long.
        """
        from concurrent.futures import FIRST_COMPLETED, wait

        running: dict[Future[Result], Item] = {}
        coming: Iterator[Item] | None = None
        with told():
            while True:
                while len(running) < AHEAD * self.workers and (item := take()) is not None:
                    running[self.submit(function, item)] = item
                if not running:
                    self._coming = tuple
                    return
                early = {future for *_, future in self._early if not future.done()}
                while len(running) + len(early) < AHEAD * self.workers:
                    coming = iter(self._coming()) if coming is None else coming
                    if (item := next(coming, None)) is None:
                        break
                    self._early.append((function, item, self._begun(function, item)))
                    early.add(self._early[-1][-1])
                for future in wait({*running, *early}, return_when=FIRST_COMPLETED).done & running.keys():
                    yield running.pop(future), future.result()

    def submit(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        """function(item), to be done by a process, which may have begun already."""
        for i, (what, of, future) in enumerate(self._early):
            if what is function and of == item:
                del self._early[i]
                return future
        return self._begun(function, item)

    def _begun(self, function: Callable[[Item], Result], item: Item) -> Future[Result]:
        with self._starting:
            if self._processes is None:
                import multiprocessing
                from concurrent.futures import ProcessPoolExecutor

                blas.one_thread()
                _start_tracker()
                spawn = multiprocessing.get_context("spawn")
                self._processes = ProcessPoolExecutor(self.workers, mp_context=spawn, initializer=_serve)
        with interrupts_held():  # submitting starts the processes
            return self._processes.submit(function, item)


def _import(modules: Sequence[str]) -> int:
    """Import modules; the process that has done so."""
    for name in modules:
        import_module(name)
    time.sleep(SETTLE)
    return os.getpid()


@contextmanager
def told() -> Iterator[None]:
    """The death of a worker as one message for the user."""
    from concurrent.futures.process import BrokenProcessPool

    try:
        yield
    except BrokenProcessPool as error:
        raise RkfbenchError(
            "a worker process was killed (out of memory?); finished blocks are kept: run the same command again, "
            "with fewer --jobs if memory was short"
        ) from error


@contextmanager
def interrupts_held() -> Iterator[None]:
    """A Ctrl-C that comes now is answered afterwards. Processes started here hold theirs too, until they `_serve`:
    Ctrl-C reaches every process of a terminal, and one that is still importing would answer with a traceback.
    """
    _start_tracker()  # now: its start, which the first process would be the occasion for, unblocks signals
    # Another thread may take the signal: so Python's answer waits too. It goes first, and last: nothing raises between.
    with held():
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


@cache
def _start_tracker() -> None:
    """Start Python's process that removes what others leave behind. A command that ends at once, as after a Ctrl-C,
    relies on it; nobody needs to read how much that was.
    """
    from multiprocessing import resource_tracker

    name = "PYTHONWARNINGS"
    before = os.environ.get(name)
    os.environ[name] = ",".join(filter(None, (before, "ignore:resource_tracker:UserWarning")))
    try:
        resource_tracker.ensure_running()
    finally:
        del os.environ[name]
        os.environ.update({} if before is None else {name: before})


def _serve() -> None:
    """In a worker: leave Ctrl-C to the driver, and end with the driver, however that ends; results are returned, so
    what is printed is no result.
    """
    import multiprocessing

    stderr.all_there()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.set_threshold(COLLECT)
    driver = multiprocessing.parent_process()

    def follow() -> None:
        if driver is not None:
            driver.join()
            os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
