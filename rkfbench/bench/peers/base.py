"""What a peer is: one implementation of one filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from rkfbench.bench.problems import Problem
from rkfbench.linalg import Array


class Task(NamedTuple):
    """A filter made ready for a problem: `call` is what is timed, `means` brings what it returns into (T, n, M)."""

    call: Callable[[], Any]
    means: Callable[[Any], Array]


@dataclass(frozen=True)
class Peer:
    """One implementation of one filter. `ready` may take its time: copies, layouts, objects.

    `most`: a loop in Python is timed on so many runs at most, as its cost a run does not depend on their number.
    `compiled`: its first call for a new shape compiles, and is reported apart.
    """

    name: str
    filter: str
    ready: Callable[[Problem], Task]
    most: int | None = None
    compiled: bool = False


def time_first(means: Any) -> Array:
    """(M, T, n) as (T, n, M)."""
    return np.asarray(means).transpose(1, 2, 0)


def missing_package(name: str) -> str | None:
    """Why a peer cannot run that needs this package; None if it is installed."""
    return None if find_spec(name) else "not installed"
