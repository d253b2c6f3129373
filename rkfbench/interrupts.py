"""Ctrl-C at a better moment."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def held() -> Iterator[None]:
    """A Ctrl-C that comes now is answered afterwards: for work that would swallow it, or end half done.

    pydantic, for one, turns a KeyboardInterrupt inside of it into an error of its own, and may go on.
    """
    if threading.current_thread() is not threading.main_thread():  # where Python answers signals
        yield
        return
    came: list[int] = []
    answer = signal.signal(signal.SIGINT, lambda number, _: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, answer or signal.SIG_DFL)
        if came:
            signal.raise_signal(signal.SIGINT)
