"""How many examples, and bounds on the time and memory of each: what breaks them fails instead of hanging the tests."""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from hypothesis import HealthCheck, settings

ODD = {"deadline": None, "suppress_health_check": list(HealthCheck)}  # `bounded` has the deadline
settings.register_profile("quick", max_examples=200, derandomize=True, database=None, **ODD)
settings.register_profile("nightly", max_examples=3000, print_blob=True, **ODD)
PROFILE = settings.get_profile(os.environ.get("FUZZ", "quick"))  # 200 in all, always the same; or 3000 new ones


def percent(share: int) -> settings:
    """Some of the examples."""
    return settings(PROFILE, max_examples=PROFILE.max_examples * share // 100)


SECONDS = 10.0  # of CPU
MEMORY = 512 * 2**20  # bytes above what the process has


class TooLong(BaseException):
    """Not an Exception: nothing in between may take it for an ordinary failure."""


@contextmanager
def bounded(seconds: float = SECONDS, memory: int = MEMORY) -> Iterator[None]:
    """TooLong or MemoryError in what needs more (CPU time, so that a busy machine changes nothing)."""

    def expired(signum: int, frame: FrameType | None) -> None:
        raise TooLong(f"more than {seconds} s of CPU")

    old_handler = signal.signal(signal.SIGPROF, expired)
    old_limits = resource.getrlimit(resource.RLIMIT_AS)
    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (has + memory, old_limits[1]))
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, old_handler)
        resource.setrlimit(resource.RLIMIT_AS, old_limits)
