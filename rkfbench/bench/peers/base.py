"""What a peer is: one implementation of one filter."""

from __future__ import annotations

import math
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


Ready = Callable[[Problem], Task]
OURS = "rkfbench"  # the name of our own filters among the peers


@dataclass(frozen=True)
class Peer:
    """One implementation of one filter. `ready` may take its time: copies, layouts, objects.

    `most`: a loop in Python is timed on so many runs at most, as its cost a run does not depend on their number.
    `compiled`: its first call for a new shape compiles, and is reported apart.
    `tolerance`: how far its means may be from ours, in standard deviations of that state over runs and steps.
    """

    name: str
    filter: str
    ready: Ready
    most: int | None = None
    compiled: bool = False
    tolerance: float = 1e-9


def time_first(means: Any) -> Array:
    """(M, T, n) as (T, n, M)."""
    return np.asarray(means).transpose(1, 2, 0)


def missing_package(name: str) -> str | None:
    """Why a peer cannot run that needs this package; None if it is installed."""
    return None if find_spec(name) else "not installed"


def one_state(problem: Problem) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
    """f and h of the altitude model for one state, written as a user would."""
    F = problem.model.F(problem.x0, 1)

    def h(x: Array) -> Array:
        r = math.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2)
        return np.array([math.atan2(x[1], x[0]), r, x[2], (x[0] * x[3] + x[1] * x[4] + x[2] * x[5]) / r])

    return lambda x: F @ x, h


def predicted(problem: Problem) -> tuple[Array, Array]:
    """Mean and covariance before the first measurement, F x0 and F P0 F' + Q, as those want them who start there."""
    F = problem.model.F(problem.x0, 1)
    return F @ problem.x0, F @ problem.P0 @ F.T + problem.Q
