"""pykalman: one run after the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, missing_package, one_state, predicted, time_first
from rkfbench.bench.problems import Problem


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("pykalman")


def kalman(problem: Problem) -> Task:
    """KalmanFilter.filter."""
    from pykalman import KalmanFilter

    F, H = problem.matrices
    x0, P0 = predicted(problem)
    filt = KalmanFilter(F, H, problem.Q, problem.R, initial_state_mean=x0, initial_state_covariance=P0)
    return _one_by_one(filt, problem)


def unscented(problem: Problem) -> Task:
    """AdditiveUnscentedKalmanFilter.filter, whose points are alpha = 1, beta = 0, kappa = 3 - n."""
    from pykalman import AdditiveUnscentedKalmanFilter

    f, h = one_state(problem)
    return _one_by_one(AdditiveUnscentedKalmanFilter(f, h, problem.Q, problem.R, *predicted(problem)), problem)


def _one_by_one(filt: Any, problem: Problem) -> Task:
    y = problem.by_run
    return Task(lambda: np.stack([filt.filter(run)[0] for run in y]), time_first)


PEERS = (Peer("pykalman", "kf", kalman, most=2), Peer("pykalman", "ukf", unscented, most=2))
