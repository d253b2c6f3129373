"""The filters of this package, as `filters.build` gives them to a user."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from rkfbench import filters
from rkfbench.bench.peers.base import OURS, Peer, Ready, Task
from rkfbench.bench.problems import PARTICLES, PARTS, THRESHOLD, Problem
from rkfbench.linalg import Array


def missing() -> None:
    """Always there."""


PARAMS: Mapping[str, Mapping[str, Any]] = {
    "kf": {},
    "hkf": {"threshold": THRESHOLD},
    "aladkf": {},
    "ukf": {},
    "ckf": {},
    "pekf": {"dl": 1 / PARTS},
    "pf": {"particles": PARTICLES},
}


def estimate(name: str, problem: Problem, P0: Array | None = None) -> filters.Estimate:
    """The estimates of a filter; P0 (n, n) or (n, n, M) in the place of the problem's own."""
    filt = filters.build(name, **PARAMS[name])
    P0 = problem.P0 if P0 is None else P0
    return filt.run(problem.model, problem.y, problem.x0, P0, Q=problem.Q, R=problem.R, keep=())


def ready(name: str, problem: Problem) -> Task:
    """As a user runs it: all runs begin with the same covariance."""
    return Task(partial(estimate, name, problem), lambda done: done.mean)


def own_covariances(problem: Problem) -> Task:
    """The KF where every run begins with a covariance of its own (they are equal, which the filter does not know)."""
    P0 = np.repeat(problem.P0[..., None], problem.runs, axis=2)
    return Task(partial(estimate, "kf", problem, P0), lambda done: done.mean)


MAKERS: Mapping[str, Ready] = {
    "kf": partial(ready, "kf"),
    "kf_own": own_covariances,
    **{name: partial(ready, name) for name in ("hkf", "aladkf", "ukf", "ckf", "pekf", "pf")},
}
PEERS = tuple(Peer(OURS, name, make) for name, make in MAKERS.items())
