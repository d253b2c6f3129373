"""FilterPy: one filter object a run, in a Python loop over runs and steps, as its documentation uses it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, missing_package, one_state, time_first
from rkfbench.bench.problems import THRESHOLD, Problem
from rkfbench.linalg import Array, root
from rkfbench.noise.matrices import factor

MOST = 4
Step = Callable[[Any, Array], None]
Maker = Callable[[Problem], tuple[Callable[[], Any], Step]]


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("filterpy")


def ready(make: Maker, problem: Problem) -> Task:
    """`make` gives a function that makes a filter, and one step of it."""
    new, step = make(problem)
    y = problem.by_run

    def call() -> Array:
        means = np.empty((*y.shape[:2], len(problem.x0)))
        for r, run in enumerate(y):
            filt = new()
            for k, yk in enumerate(run):
                step(filt, yk)
                means[r, k] = filt.x.ravel()
        return means

    return Task(call, time_first)


def kalman(problem: Problem) -> tuple[Callable[[], Any], Step]:
    """KalmanFilter, with plain R."""
    from filterpy.kalman import KalmanFilter

    F, H = problem.matrices

    def new() -> Any:
        return _told(KalmanFilter(len(F), len(H)), problem, F=F, H=H)

    def step(filt: Any, y: Array) -> None:
        filt.predict()
        filt.update(y)

    return new, step


def robust(inflate: Callable[[Array], Callable[[Array], Array]], problem: Problem) -> tuple[Callable[[], Any], Step]:
    """KalmanFilter, told another R in each step, that depends on the innovation."""
    new, _ = kalman(problem)
    inflated = inflate(problem.R)

    def step(filt: Any, y: Array) -> None:
        filt.predict()
        filt.update(y, R=inflated(y - filt.H @ filt.x))

    return new, step


def huber(R: Array) -> Callable[[Array], Array]:
    """R' = L diag(max(1, |e|/threshold)) L', e = L^-1 nu."""
    L = root(R)
    inverse = np.linalg.inv(L)
    return lambda nu: (L * np.maximum(1.0, np.abs(inverse @ nu) / THRESHOLD)) @ L.T


def least_absolute(R: Array) -> Callable[[Array], Array]:
    """R' = lambda R, lambda = |L^-1 nu|."""
    inverse = np.linalg.inv(factor(R))
    return lambda nu: np.linalg.norm(inverse @ nu) * R


def unscented(problem: Problem) -> tuple[Callable[[], Any], Step]:
    """UnscentedKalmanFilter with alpha = 1, beta = 0, kappa = 3 - n."""
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    n, m = len(problem.x0), len(problem.R)
    points = MerweScaledSigmaPoints(n, alpha=1.0, beta=0.0, kappa=3.0 - n)
    f, h = one_state(problem)

    def new() -> Any:
        return _told(UnscentedKalmanFilter(n, m, 1.0, h, lambda x, dt: f(x), points), problem)

    def step(filt: Any, y: Array) -> None:
        filt.predict()
        filt.update(y)

    return new, step


def cubature(problem: Problem) -> tuple[Callable[[], Any], Step]:
    """CubatureKalmanFilter; it would take the propagated points for the update, so new ones are drawn between."""
    from filterpy.kalman.CubatureKalmanFilter import CubatureKalmanFilter, spherical_radial_sigmas

    n, m = len(problem.x0), len(problem.R)
    f, h = one_state(problem)

    def new() -> Any:
        filt = _told(CubatureKalmanFilter(n, m, 1.0, h, lambda x, dt: f(x)), problem)
        filt.x = problem.x0[:, None]
        return filt

    def step(filt: Any, y: Array) -> None:
        filt.predict()
        filt.sigmas_f = spherical_radial_sigmas(filt.x, filt.P)
        filt.update(y[:, None])

    return new, step


def _told(filt: Any, problem: Problem, **more: Any) -> Any:
    filt.x, filt.P = problem.x0.copy(), problem.P0.copy()
    filt.Q, filt.R = problem.Q, problem.R
    for name, value in more.items():
        setattr(filt, name, value)
    return filt


MAKERS: Mapping[str, Maker] = {
    "kf": kalman,
    "hkf": partial(robust, huber),
    "aladkf": partial(robust, least_absolute),
    "ukf": unscented,
    "ckf": cubature,
}
PEERS = tuple(Peer("FilterPy", name, partial(ready, make), most=MOST) for name, make in MAKERS.items())
