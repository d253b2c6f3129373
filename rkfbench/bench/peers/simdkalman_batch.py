"""simdkalman: all runs at once, in NumPy with the run axis first."""

from __future__ import annotations

from typing import Any

from rkfbench.bench.peers.base import Peer, Task, missing_package, predicted, time_first
from rkfbench.bench.problems import Problem


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("simdkalman")


def kalman(problem: Problem) -> Task:
    """KalmanFilter.compute, filtered states without covariances."""
    import simdkalman

    F, H = problem.matrices
    x0, P0 = predicted(problem)
    filt = simdkalman.KalmanFilter(F, problem.Q, H, problem.R)
    y = problem.by_run

    def call() -> Any:
        return filt.compute(
            y, 0, x0, P0, smoothed=False, filtered=True, covariances=False, observations=False
        ).filtered.states.mean

    return Task(call, time_first)


PEERS = (Peer("simdkalman", "kf", kalman),)
