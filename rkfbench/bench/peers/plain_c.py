"""The C kernels of `kernels.py`: one run after the other, each with a covariance of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from rkfbench.bench import kernels
from rkfbench.bench.peers.base import Peer, Task, time_first
from rkfbench.bench.problems import PARTICLES, PARTS, SEED, THRESHOLD, Problem
from rkfbench.filters.sigma import Cubature, Unscented
from rkfbench.linalg import Array, root
from rkfbench.noise.matrices import factor

Arguments = Callable[[Problem], list[Any]]


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return None if kernels.compiler() else "no C compiler"


def ready(file: str, function: str, told: Callable[[Problem], list[Array]], more: Arguments, problem: Problem) -> Task:
    """A kernel takes runs, steps, what the filter is told, y (M, T, m), out (M, T, n) and what else it needs."""
    out = np.empty((problem.runs, problem.steps, len(problem.x0)))
    kernel = kernels.bound(
        file, function, problem.runs, problem.steps, told(problem), problem.by_run, out, *more(problem)
    )

    def call() -> Array:
        kernel()
        return out

    return Task(call, time_first)


def _linear(p: Problem) -> list[Array]:
    return [*p.matrices, p.Q, p.R, p.x0, p.P0]


def _altitude(p: Problem) -> list[Array]:
    return [p.model.F(p.x0, 1), p.Q, p.R, p.x0, p.P0, np.array([p.model.dt])]


def _particle(p: Problem) -> list[Array]:
    return [*p.matrices, p.x0, factor(p.P0), factor(p.Q), np.linalg.inv(factor(p.R))]


def _gains(p: Problem) -> list[Any]:
    return [np.empty((p.steps, len(p.x0), len(p.R)))]


def _huber(p: Problem) -> list[Any]:
    L = root(p.R)
    return [L, np.linalg.inv(L), THRESHOLD]


def _least_absolute(p: Problem) -> list[Any]:
    return [np.linalg.inv(factor(p.R))]


def _weights(rule: Any, p: Problem) -> list[Any]:
    """Distance of the points, and the centre's weight in means and in covariances, of the rules of `filters.sigma`."""
    h2, _, b = rule.rule(len(p.x0))
    centre = 1 - len(p.x0) / h2
    return [float(np.sqrt(h2)), centre, centre + 1 + b]


def _particles(p: Problem) -> list[Any]:
    return [np.empty((3 * len(p.x0) + 2) * PARTICLES), PARTICLES, SEED]


PEERS = (
    Peer("C, own P", "kf", partial(ready, "linear", "kf", _linear, lambda p: [])),
    Peer("C", "kf", partial(ready, "linear", "kf_shared", _linear, _gains)),
    Peer("C", "hkf", partial(ready, "linear", "hkf", _linear, _huber)),
    Peer("C", "aladkf", partial(ready, "linear", "aladkf", _linear, _least_absolute)),
    Peer("C", "ukf", partial(ready, "altitude", "sigma", _altitude, partial(_weights, Unscented()))),
    Peer("C", "ckf", partial(ready, "altitude", "sigma", _altitude, partial(_weights, Cubature()))),
    Peer("C", "pekf", partial(ready, "altitude", "pekf", _altitude, lambda p: [PARTS])),
    Peer("C", "pf", partial(ready, "particle", "pf", _particle, _particles)),
)
