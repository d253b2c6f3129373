"""Filters of Stone Soup: `{use: rkfbench.adapters.stonesoup:kf}`, `ekf`, `ukf`, each a predictor with its updater.

The model's functions become a transition and a measurement model of Stone Soup; one step is one second of its clock.
Angles are wrapped as the model wraps them. Of a measurement some of whose components are missing the others are used.
"""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt
from stonesoup.base import Property
from stonesoup.models.base import GaussianModel
from stonesoup.models.measurement import MeasurementModel
from stonesoup.models.transition import TransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.array import CovarianceMatrix, StateVector, StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from rkfbench.errors import SpecError
from rkfbench.linalg import Array
from rkfbench.models import Model, Observed

START = datetime(2000, 1, 1)


class Transition(TransitionModel, GaussianModel):
    """x_k = f(x_{k-1}) + w_k at the step `k`."""

    model: Any = Property(doc="the model of rkfbench")
    Q: Any = Property(doc="covariance of the process noise")
    k: int = Property(default=1, doc="the step that is reached")

    @property
    def ndim_state(self) -> int:
        return len(self.model.states)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        points = np.asarray(state.state_vector, dtype=float)
        return self.model.f(points, self.k).view(StateVectors if points.shape[1] > 1 else StateVector)

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        return np.asarray(self.model.F(np.asarray(state.state_vector, dtype=float)[:, 0], self.k))

    def covar(self, **kwargs: Any) -> Any:
        return CovarianceMatrix(self.Q)


class Measurement(MeasurementModel, GaussianModel):
    """y_k = h(x_k) + v_k at the step `k`; values at several points are offsets from the first, angles wrapped."""

    ndim_state: int = Property(default=0, doc="not used")
    mapping: Any = Property(default=(), doc="not used")
    model: Any = Property(doc="the model of rkfbench")
    R: Any = Property(doc="covariance of the measurement noise")
    k: int = Property(default=1, doc="the step that is measured")

    @property
    def ndim_meas(self) -> int:
        return len(self.model.measurements)

    def function(self, state: Any, noise: Any = False, **kwargs: Any) -> Any:
        points = np.asarray(state.state_vector, dtype=float)
        values = self.model.h(points, self.k)
        if points.shape[1] == 1:
            return values.view(StateVector)
        return (values[:, :1] + self.model.residual(values, values[:, :1])).view(StateVectors)

    def jacobian(self, state: Any, **kwargs: Any) -> Array:
        return np.asarray(self.model.H(np.asarray(state.state_vector, dtype=float)[:, 0], self.k))

    def covar(self, **kwargs: Any) -> Any:
        return CovarianceMatrix(self.R)


class _Adapted:
    """A predictor and an updater on the state of one run."""

    def __init__(
        self, predictor: type, updater: type, model: Model, x0: Array, P0: Array, Q: Array, **params: Any
    ) -> None:
        self.model = model
        self.transition = Transition(model=model, Q=Q)
        self.predictor, self.updater = predictor(self.transition, **params), updater(None, **params)
        self.state = GaussianState(StateVector(x0), CovarianceMatrix(P0), timestamp=START)

    @property
    def x(self) -> Array:
        """Mean (n,)."""
        return np.asarray(self.state.state_vector, dtype=float)[:, 0]

    @property
    def P(self) -> Array:
        """Covariance (n, n)."""
        return np.asarray(self.state.covar, dtype=float)

    def predict(self, k: int, Q: Array) -> None:
        """Stone Soup's prediction."""
        self.transition.k, self.transition.Q = k, Q
        self.state = self.predictor.predict(self.state, timestamp=START + timedelta(seconds=k))

    def update(self, y: Array, k: int, R: Array) -> None:
        """Stone Soup's update with y, put so that its innovation is that of the model, with angles wrapped."""
        rows = np.flatnonzero(~np.isnan(y))
        model = self.model if len(rows) == len(y) else Observed(self.model, rows)
        measurement = Measurement(model=model, R=R[np.ix_(rows, rows)], k=k)
        expected = self.updater.predict_measurement(self.state, measurement)
        z = np.asarray(expected.state_vector, dtype=float)[:, 0]
        self.nu, self.S = model.residual(y[rows], z), np.asarray(expected.covar, dtype=float)
        detection = Detection(StateVector(z + self.nu), START + timedelta(seconds=k), measurement)
        self.state = self.updater.update(SingleHypothesis(self.state, detection, expected))
        # without what it was made from, which would keep all earlier states alive
        self.state = GaussianState(self.state.state_vector, self.state.covar, timestamp=self.state.timestamp)


class kf(_Adapted):  # noqa: N801 - the name that a scenario writes
    """Kalman filter of Stone Soup: its extended predictor and updater on a linear model."""

    def __init__(self, model: Model, x0: Array, P0: Array, Q: Array, R: Array) -> None:
        super().__init__(ExtendedKalmanPredictor, ExtendedKalmanUpdater, model, x0, P0, Q)

    @staticmethod
    def check(model: Model) -> None:
        """SpecError unless the model is linear."""
        if not model.linear:
            raise SpecError("a Kalman filter needs a linear model")


class ekf(_Adapted):  # noqa: N801
    """Extended Kalman filter of Stone Soup."""

    def __init__(self, model: Model, x0: Array, P0: Array, Q: Array, R: Array) -> None:
        super().__init__(ExtendedKalmanPredictor, ExtendedKalmanUpdater, model, x0, P0, Q)


class ukf(_Adapted):  # noqa: N801
    """Unscented Kalman filter of Stone Soup."""

    def __init__(
        self,
        model: Model,
        x0: Array,
        P0: Array,
        Q: Array,
        R: Array,
        alpha: Annotated[float, Gt(0), "spread of the points"] = 1.0,
        beta: Annotated[float, "weight of the centre in covariances"] = 0.0,
        kappa: Annotated[float | Literal["3-n"], "second spread, n + kappa > 0"] = "3-n",
    ) -> None:
        spread = None if kappa == "3-n" else kappa
        predictor, updater = UnscentedKalmanPredictor, UnscentedKalmanUpdater
        super().__init__(predictor, updater, model, x0, P0, Q, alpha=alpha, beta=beta, kappa=spread)
