"""Stone Soup: predictor, hypothesis and updater objects, in a Python loop over runs and steps, as in its tutorials."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np

from rkfbench.bench.peers.base import Peer, Task, missing_package, one_state, time_first
from rkfbench.bench.problems import Problem
from rkfbench.linalg import Array

START, SECOND = datetime(2020, 1, 1), timedelta(seconds=1)


def missing() -> str | None:
    """Why these peers cannot run here; None if they can."""
    return missing_package("stonesoup")


def ready(parts: Callable[[Problem], tuple[Any, Any]], problem: Problem) -> Task:
    """`parts` gives predictor and updater."""
    from stonesoup.types.detection import Detection
    from stonesoup.types.hypothesis import SingleHypothesis
    from stonesoup.types.state import GaussianState

    predictor, updater = parts(problem)
    y, n = problem.by_run, len(problem.x0)
    times = [START + k * SECOND for k in range(problem.steps + 1)]

    def call() -> Array:
        means = np.empty((*y.shape[:2], n))
        for r, run in enumerate(y):
            state = GaussianState(problem.x0[:, None], problem.P0, timestamp=START)
            for k, yk in enumerate(run):
                prediction = predictor.predict(state, timestamp=times[k + 1])
                detection = Detection(yk[:, None], timestamp=times[k + 1])
                state = updater.update(SingleHypothesis(prediction, detection))
                means[r, k] = state.state_vector[:, 0]
        return means

    return Task(call, time_first)


def kalman(problem: Problem) -> tuple[Any, Any]:
    """KalmanPredictor and KalmanUpdater."""
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.updater.kalman import KalmanUpdater

    _, H = problem.matrices
    measured = LinearGaussian(len(problem.x0), [int(row.argmax()) for row in H], problem.R)
    return KalmanPredictor(_motion(problem)), KalmanUpdater(measured)


def unscented(problem: Problem) -> tuple[Any, Any]:
    """UnscentedKalmanPredictor and UnscentedKalmanUpdater with alpha = 1, beta = 0, kappa = 3 - n."""
    from stonesoup.predictor.kalman import UnscentedKalmanPredictor
    from stonesoup.updater.kalman import UnscentedKalmanUpdater

    rule = {"alpha": 1.0, "beta": 0.0, "kappa": 3.0 - len(problem.x0)}
    return UnscentedKalmanPredictor(_motion(problem), **rule), UnscentedKalmanUpdater(_sight(problem), **rule)


def cubature(problem: Problem) -> tuple[Any, Any]:
    """CubatureKalmanPredictor and CubatureKalmanUpdater."""
    from stonesoup.predictor.kalman import CubatureKalmanPredictor
    from stonesoup.updater.kalman import CubatureKalmanUpdater

    return CubatureKalmanPredictor(_motion(problem)), CubatureKalmanUpdater(_sight(problem))


def _motion(problem: Problem) -> Any:
    from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel

    F = problem.model.F(problem.x0, 1)
    return LinearGaussianTimeInvariantTransitionModel(transition_matrix=F, covariance_matrix=problem.Q)


def _sight(problem: Problem) -> Any:
    """The altitude model's h as a measurement model."""
    from stonesoup.models.measurement.nonlinear import NonLinearGaussianMeasurement
    from stonesoup.types.array import StateVector, StateVectors

    _, h = one_state(problem)

    class Sight(NonLinearGaussianMeasurement):
        @property
        def ndim_meas(self) -> int:
            return len(problem.R)

        def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
            points = np.asarray(state.state_vector, dtype=float).T
            kind = StateVector if len(points) == 1 else StateVectors
            return kind(np.column_stack([h(point) for point in points]))

    return Sight(ndim_state=6, mapping=tuple(range(6)), noise_covar=problem.R)


PEERS = tuple(
    Peer("Stone Soup", name, partial(ready, parts), most=2)
    for name, parts in {"kf": kalman, "ukf": unscented, "ckf": cubature}.items()
)
