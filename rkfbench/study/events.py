"""What a study tells while it runs, to whoever listens: a terminal, a log, a test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Planned:
    """The work is known: in how many blocks something has to be computed."""

    missing: int


@dataclass(frozen=True)
class Recomputing:
    """Numbers of some cases that were there cannot be used again, and why."""

    cases: tuple[str, ...]
    reason: str


@dataclass(frozen=True)
class Spoiled:
    """Files of the folder that are not what was written there; they are made again."""

    files: tuple[str, ...]


@dataclass(frozen=True)
class Looped:
    """A filter of one run is looped over the runs: microseconds a run and step, how many times that of a Kalman filter
    on a batch of runs, and about how many seconds of one core in all.
    """

    filter: str
    microseconds: float
    ratio: float
    seconds: float


@dataclass(frozen=True)
class BlockDone:
    """A block is on the disk."""

    case: str


@dataclass(frozen=True)
class CaseDone:
    """All blocks of a case for which something had to be computed are on the disk."""

    case: str
    runs: int
    filters: int


@dataclass(frozen=True)
class Failure:
    """A filter raised in a block; the other filters and blocks were completed."""

    case: str
    filter: str
    block: int
    message: str
    traceback: str

    def __str__(self) -> str:
        return f"case {self.case}, filter {self.filter}, block {self.block}: {self.message}"


@dataclass(frozen=True)
class Died:
    """Runs of a filter failed: all of a case, or some and it is known how the first one died."""

    filter: str
    failed: int
    runs: int  # that were computed
    first: str  # case, run, step and what happened; of a case that failed as a whole perhaps no more than its name

    def __str__(self) -> str:
        return f"{self.filter}: {self.failed} of {self.runs} runs failed; first: {self.first}"


@dataclass(frozen=True)
class Stopped:
    """The number of runs that was looked for is found, and why it is this."""

    text: str


Event = Planned | Recomputing | Spoiled | Looped | BlockDone | CaseDone | Failure | Died | Stopped
Report = Callable[[Event], None]
