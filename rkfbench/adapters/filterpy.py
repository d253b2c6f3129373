"""Filters of FilterPy: `{use: rkfbench.adapters.filterpy:kf}`, `ekf`, `ukf`.

They are filters of one run, with FilterPy's own predict and update; the model's functions stand in for its F, H, fx and
hx. Angles are wrapped as the model wraps them. Of a measurement some of whose components are missing the others are
used.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Gt
from filterpy.kalman import ExtendedKalmanFilter, KalmanFilter, MerweScaledSigmaPoints, UnscentedKalmanFilter

from rkfbench.errors import SpecError
from rkfbench.linalg import Array
from rkfbench.models import Model, Observed


class _Adapted:
    """A FilterPy filter that is told the model, with x, P, nu and S as those of the filter inside."""

    def __init__(self, inside: Any, model: Model, x0: Array, P0: Array) -> None:
        self.inside, self.model = inside, model
        inside.x, inside.P = x0, P0

    @property
    def x(self) -> Array:
        """Mean (n,)."""
        return np.asarray(self.inside.x)

    @property
    def P(self) -> Array:
        """Covariance (n, n)."""
        return np.asarray(self.inside.P)

    @property
    def nu(self) -> Array:
        """Innovation of the components that were there."""
        return np.asarray(self.inside.y)

    @property
    def S(self) -> Array:
        """Its covariance."""
        return np.asarray(self.inside.S)

    def observed(self, y: Array, R: Array) -> tuple[Any, Array, Array]:
        """The model, the measurement and its R of those components that are there."""
        rows = np.flatnonzero(~np.isnan(y))
        if len(rows) == len(y):
            return self.model, y, R
        return Observed(self.model, rows), y[rows], R[np.ix_(rows, rows)]


class kf(_Adapted):  # noqa: N801 - the name that a scenario writes
    """Kalman filter of FilterPy, for linear models with or without a known input."""

    def __init__(self, model: Model, x0: Array, P0: Array, Q: Array, R: Array) -> None:
        super().__init__(KalmanFilter(len(x0), len(R)), model, x0, P0)

    def predict(self, k: int, Q: Array) -> None:
        """x = F x + B u, P = F P F' + Q."""
        x = self.inside.x
        F = self.model.F(x, k)
        offset = self.model.f(np.zeros_like(x), k)  # B u
        self.inside.predict(u=offset, B=np.eye(len(x)), F=F, Q=Q)

    def update(self, y: Array, k: int, R: Array) -> None:
        """The update with y."""
        model, z, R = self.observed(y, R)
        self.inside.update(z, R=R, H=model.H(self.inside.x, k))

    @staticmethod
    def check(model: Model) -> None:
        """SpecError unless the model is linear."""
        if not model.linear:
            raise SpecError("a Kalman filter needs a linear model")


class ekf(_Adapted):  # noqa: N801
    """Extended Kalman filter of FilterPy; F is the Jacobian of f at the last estimate."""

    def __init__(self, model: Model, x0: Array, P0: Array, Q: Array, R: Array) -> None:
        super().__init__(ExtendedKalmanFilter(len(x0), len(R)), model, x0, P0)

    def predict(self, k: int, Q: Array) -> None:
        """x = f(x), P = F P F' + Q."""
        reached = self.model.f(self.inside.x, k)
        self.inside.F, self.inside.Q = self.model.F(self.inside.x, k), Q
        self.inside.predict_x = lambda u: setattr(self.inside, "x", reached)
        self.inside.predict()

    def update(self, y: Array, k: int, R: Array) -> None:
        """The update with y."""
        model, z, R = self.observed(y, R)
        self.inside.update(
            z, HJacobian=lambda x: model.H(x, k), Hx=lambda x: model.h(x, k), R=R, residual=model.residual
        )


class ukf(_Adapted):  # noqa: N801
    """Unscented Kalman filter of FilterPy with the scaled points of van der Merwe."""

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
        n = len(x0)
        points = MerweScaledSigmaPoints(n, alpha, beta, 3.0 - n if kappa == "3-n" else kappa)
        inside = UnscentedKalmanFilter(n, len(R), 1.0, None, None, points, residual_z=model.residual)
        super().__init__(inside, model, x0, P0)

    def predict(self, k: int, Q: Array) -> None:
        """The unscented transform of f, + Q; new points are drawn at the prediction."""
        self.inside.Q = Q
        self.inside.predict(fx=lambda x, dt: self.model.f(x, k))
        self.inside.sigmas_f = self.inside.points_fn.sigma_points(self.inside.x, self.inside.P)

    def update(self, y: Array, k: int, R: Array) -> None:
        """The update with y; angles are offsets from the central point, wrapped before they are averaged."""
        model, z, R = self.observed(y, R)
        centre = model.h(self.inside.sigmas_f[0], k)
        self.inside.residual_z = model.residual
        self.inside.update(z, R=R, hx=lambda x: centre + model.residual(model.h(x, k), centre))
