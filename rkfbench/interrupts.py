"""Ctrl-C: not lost where something swallows it, and answered at a better moment where one is needed."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

AGAIN = 0.05  # seconds

_came = False


def insist() -> None:
    """From now on a Ctrl-C raises KeyboardInterrupt again and again, until one is being answered.

    A single one can be lost: destructors, callbacks and some C code have nowhere to raise it, and a bare `except:`
    somewhere takes it for its own. Where Ctrl-C is ignored from outside (nohup), it stays so.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _raise)
        if hasattr(signal, "SIGALRM"):  # elsewhere (Windows) it is raised once
            signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))


def came() -> bool:
    """Whether there was a Ctrl-C: then what failed since may be its doing."""
    return _came


def ignore() -> None:
    """No Ctrl-C is raised any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _come_again(0)


@contextmanager
def held() -> Iterator[None]:
    """A Ctrl-C that comes now is answered afterwards: for work that would swallow it, or end half done.

    pydantic, for one, turns a KeyboardInterrupt inside of it into an error of its own, and may go on.
    """
    if threading.current_thread() is not threading.main_thread():  # where Python answers signals
        yield
        return
    late: list[int] = []
    answer = signal.signal(signal.SIGINT, lambda number, _: late.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, answer or signal.SIG_DFL)
        if late:
            signal.raise_signal(signal.SIGINT)


def _raise(number: int, frame: FrameType | None) -> None:
    global _came  # of the process, as signals are
    _came = True
    _come_again(AGAIN)
    if not _being_answered():
        raise KeyboardInterrupt


def _come_again(seconds: float) -> None:
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _being_answered() -> bool:
    """Whether the main thread is in an `except`, a `finally` or the end of a `with` that an interruption has led to."""
    error = sys.exception()
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__context__
    return error is not None
