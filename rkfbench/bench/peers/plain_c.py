"""The C kernels of `kernels.py`, one run after the other and 8 at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from rkfbench.bench import kernels
from rkfbench.bench.peers.base import Peer, Task
from rkfbench.bench.problems import PARTICLES, PARTS, SEED, THRESHOLD, Problem
from rkfbench.filters.sigma import Cubature, Unscented
from rkfbench.linalg import Array, root
from rkfbench.noise.matrices import factor

Arguments = Callable[[Problem], list[Any]]  # to `kernels.bound`


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return kernels.refusal()


@dataclass(frozen=True)
class Kernel:
    """A function of a C file. It takes runs, steps, what the filter is told, y (M, T, m), out (M, T, n) and `more`."""

    file: str
    function: str
    told: Arguments
    more: Arguments = lambda problem: []

    def ready(self, problem: Problem, lanes: int = 1) -> Task:
        """Ready to filter so many runs at once: then y is (M/lanes, T, m, lanes), the last runs twice if need be."""
        groups, T, n = -(-problem.runs // lanes), problem.steps, len(problem.x0)
        padded = np.pad(problem.by_run, [(0, groups * lanes - problem.runs), (0, 0), (0, 0)], mode="edge")
        y = np.ascontiguousarray(padded.reshape(groups, lanes, T, -1).transpose(0, 2, 3, 1))
        out = np.empty((groups, T, n, lanes))
        kernel = kernels.bound(
            kernels.library(self.file, lanes), self.function,
            groups * lanes, T, self.told(problem), y, out, *self.more(problem),
        )  # fmt: skip

        def call() -> Array:
            kernel()
            return out

        return Task(call, lambda out: out.transpose(1, 2, 0, 3).reshape(T, n, -1)[..., : problem.runs])


def _linear(p: Problem) -> list[Array]:
    return [*p.matrices, p.Q, p.R, p.x0, p.P0]


def _altitude(p: Problem) -> list[Array]:
    return [p.model.F(p.x0, 1), p.Q, p.R, p.x0, p.P0, np.array([p.model.dt])]


def _particle(p: Problem) -> list[Array]:
    return [*p.matrices, p.x0, factor(p.P0), factor(p.Q), np.linalg.inv(factor(p.R))]


def _gains(p: Problem) -> list[Any]:
    return [np.empty((p.steps, len(p.x0), len(p.R), kernels.LANES))]


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


KERNELS = {
    "kf": Kernel("linear", "kf_shared", _linear, _gains),
    "kf_own": Kernel("linear", "kf", _linear),
    "hkf": Kernel("linear", "hkf", _linear, _huber),
    "aladkf": Kernel("linear", "aladkf", _linear, _least_absolute),
    "ukf": Kernel("altitude", "sigma", _altitude, partial(_weights, Unscented())),
    "ckf": Kernel("altitude", "sigma", _altitude, partial(_weights, Cubature())),
    "pekf": Kernel("altitude", "pekf", _altitude, lambda p: [PARTS]),
    "pf": Kernel("particle", "pf", _particle, _particles),
}
PEERS = (
    *(Peer("C", name, kernel.ready) for name, kernel in KERNELS.items()),
    *(
        Peer("C, 8 runs at once", name, partial(kernel.ready, lanes=kernels.LANES))
        for name, kernel in KERNELS.items()
        if name != "pf"
    ),
)
