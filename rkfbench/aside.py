"""Work beside the main work: things that may be done later, by a few threads.

The threads are for work that hands its heavy parts to a `Pool`: while the numbers of one experiment are computed, the
claims and figures of the one before are made, and while those are drawn the tables of another one.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self


class Aside:
    """A queue of calls with nothing to return, in so many threads; without any, each is made at once.

    Leaving the `with` block waits for all of them. What one raises is raised by the next `wait`, or at the end. An
    interruption does not wait: calls that have not begun are dropped.
    """

    def __init__(self, threads: int) -> None:
        self._threads = ThreadPoolExecutor(threads) if threads else None
        self._calls: list[Future[None]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        try:
            if kind is None:
                self.wait()
        except BaseException as late:
            kind = type(late)
            raise
        finally:
            interrupted = kind is not None and not issubclass(kind, Exception)
            if self._threads is not None:
                self._threads.shutdown(wait=not interrupted, cancel_futures=interrupted)

    def __call__(self, work: Callable[[], None]) -> None:
        """Do `work`, here and now or soon."""
        if self._threads is None:
            work()
        else:
            self._calls.append(self._threads.submit(work))

    def wait(self) -> None:
        """Until everything is done."""
        while self._calls:
            self._calls.pop(0).result()
