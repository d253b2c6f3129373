"""Work beside the main work: things that may be done later, one after the other, by one thread.

The thread is for work that hands its heavy parts to a `Pool`: while the numbers of one experiment are computed, the
claims and figures of the one before are made.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self


class Aside:
    """A queue of calls with nothing to return, in a thread; not `threaded`, each is made at once.

    Leaving the `with` block waits for all of them. What one raises is raised by the next `wait`, or at the end. An
    interruption does not wait: calls that have not begun are dropped.
    """

    def __init__(self, threaded: bool) -> None:
        self._thread = ThreadPoolExecutor(1) if threaded else None
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
            if self._thread is not None:
                self._thread.shutdown(wait=not interrupted, cancel_futures=interrupted)

    def __call__(self, work: Callable[[], None]) -> None:
        """Do `work`, here and now or soon."""
        if self._thread is None:
            work()
        else:
            self._calls.append(self._thread.submit(work))

    def wait(self) -> None:
        """Until everything is done."""
        while self._calls:
            self._calls.pop(0).result()
