"""Filters with adaptive factors: alpha_i scales the weight of measurement i, beta the weight of the prediction.
Reconstructed from the DAF paper.

    minimise   V' alpha R^-1 V + beta V_X' (P-)^-1 V_X     V = H x - y,  V_X = x - x-             (3)-(5)
    solution   x+ = x- + Kbar nu,  Kbar = (P-/beta) H' (H (P-/beta) H' + alpha^-1 R)^-1      (7)
               P+ = (beta (P-)^-1 + H' alpha R^-1 H)^-1

The sensors all measure the same quantity h'x with independent noise. Then, with p_i = alpha_i/R_i, w = sum p_i and
c = (P-/beta) h,

    x+ = x- + c (sum p_i nu_i)/(1 + h'c w),      P+ = P-/beta - c c' w/(1 + h'c w),

and the filters differ in how they find the factors. All formulas of the paper are lost; what follows rests on its
wording and on Yang's filters.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters import recursion
from rkfbench.filters.base import Estimate, Known, Posterior
from rkfbench.filters.factors import FactorForm, Floor, LambdaAlpha, LambdaBeta, factor, log_factor
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.linalg import Array, mul, outer, sandwich
from rkfbench.models import Model
from rkfbench.streams import Streams

PASSES = 20  # of the robust position of RAF, at most


class Sensors(NamedTuple):
    """What an epoch brings: innovations nu (m, M), noise variances R (m, M or 1), and the variance p = h' P- h of the
    predicted quantity (M or 1,).
    """

    nu: Array
    R: Array
    p: Array


class Factors(NamedTuple):
    """alpha (m, M); beta (1, M), or (n, M) with a factor for each state; and the standardised residuals behind them, by
    name.
    """

    alpha: Array
    beta: Array
    seen: Mapping[str, Array]


@dataclass(frozen=True)
class AdaptiveFactorFilter(ABC):
    """What the filters share; `factors` makes the difference."""

    lambda_alpha: LambdaAlpha = 2.5
    lambda_beta: LambdaBeta = 1.5
    factor: FactorForm = "exp"
    floor: Floor = 1e-6

    sees: ClassVar[frozenset[str]] = recursion.SEES | {"alpha", "beta", "u_alpha", "u_beta"}

    @abstractmethod
    def factors(self, sensors: Sensors, h: Array, P: Array, *ahead: Array) -> Factors:
        """The factors of one epoch, from the prior covariance P and h (n,), and what was found ahead of all epochs."""

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear and all sensors measure the same quantity."""
        Linear().check(model)
        H = model.H(np.zeros((len(model.states), 1)), 1)
        if np.ptp(H, axis=0).any():
            raise SpecError("adaptive-factor filters serve models whose sensors all measure the same quantity")

    def predict(self, model: Model, x: Array, P: Array, k: int, Q: Array) -> tuple[Array, Array]:
        """x- = F x, P- = F P F' + Q."""
        return model.f(x, k), sandwich(model.F(x, k), P) + Q

    def correct(self, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *ahead: Array) -> Posterior:
        """The factors of this epoch, then the weighted solution."""
        h = model.H(x, k)[0]
        nu = y - model.h(x, k)
        p = h @ mul(h[None], P)[0]
        sensors = self.sensors(Sensors(nu, np.einsum("iim->im", R), p))
        alpha, beta, seen = self.factors(sensors, h, P, *ahead)
        x, P = weighted_solution(x, P, h, sensors, alpha, beta)
        alpha = alpha if alpha.shape == y.shape else np.broadcast_to(alpha, y.shape)
        return Posterior(x, P, {"nu": nu, "S": p + R, "alpha": alpha, "beta": beta, **seen})

    def sensors(self, sensors: Sensors) -> Sensors:
        """The sensors as the filter takes them: each on its own."""
        return sensors

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The estimates; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        told = recursion.prepare(model, y, x0, P0, Q, R)
        if np.nan_to_num(told[-1][..., ~np.eye(len(model.measurements), dtype=bool), :]).any():
            raise SpecError("adaptive-factor filters need independent sensors: a diagonal R")
        return recursion.collect(self.prepared(model, *told), keep, len(y))

    def prepared(self, model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> Iterator[recursion.Step]:
        """The steps, one after the other, from arguments as `prepare` makes them."""
        return recursion.steps(self, model, y, x, P, Q, R)

    def _measurement_factors(self, sensors: Sensors) -> tuple[Array, Array]:
        """alpha and u of (8): residuals V_i = -(nu_i - c sum nu_j/R_j) of the standard solution, over sd_i = sqrt(R_i -
        c).
        """
        nu, R, p = sensors
        c = p / (1 + p * (1 / R).sum(0))
        u = np.abs(nu - c * (nu / R).sum(0)) / np.sqrt(R - c)
        return factor(u, self.lambda_alpha, self.factor, self.floor), u

    def _prediction_factor(self, u: Array) -> Array:
        """beta of (10), (1, M)."""
        return factor(u, self.lambda_beta, self.factor, self.floor)[None]


def weighted_solution(x: Array, P: Array, h: Array, sensors: Sensors, alpha: Array, beta: Array) -> tuple[Array, Array]:
    """x+ and P+ of the loss (5), with Pb = P/beta, or beta^(-1/2) P beta^(-1/2) where each state has a factor."""
    Pb = P / beta if len(beta) == 1 else P / np.sqrt(outer(beta, beta))
    c = mul(h[None], Pb)[0]
    weights = alpha / sensors.R
    w = weights.sum(0)
    scale = 1 / (1 + (h @ c) * w)
    return x + c * ((weights * sensors.nu).sum(0) * scale), Pb - outer(c, c) * (w * scale)


def simplified_residual(sensors: Sensors, weights: Array) -> Array:
    """u = |r|/sqrt(h' P- h) for the weighted mean r of the innovations: the state residual (9) without its gain."""
    return np.abs((weights * sensors.nu).sum(0) / weights.sum(0)) / np.sqrt(sensors.p)


@dataclass(frozen=True)
class DualFactorFilter(AdaptiveFactorFilter):
    """Dual adaptive factors (DAF): alpha from the residuals of the standard solution, beta from the state residual V_X
    = Kbar nu over its sd.

    All components of V_X give the same u = |sum p_i nu_i|/w / sqrt(h' P- h + sum p_i^2 R_i/w^2), so there is one beta.
    """

    order: Annotated[
        Literal["alpha_first", "separate"], "whether Kbar of (9) already has this epoch's alpha, or alpha = 1"
    ] = "alpha_first"
    u_cov: Annotated[
        Literal["nominal", "inflated"], "covariance of nu behind the sd of V_X: with R, or with R/alpha"
    ] = "nominal"
    fuse: Annotated[bool, "take the weighted mean of the sensors as one measurement, with one alpha"] = False

    sees: ClassVar[frozenset[str]] = AdaptiveFactorFilter.sees | {"u_simplified"}

    def sensors(self, sensors: Sensors) -> Sensors:
        """The sensors one by one, or their weighted mean with its variance 1/sum(1/R_i)."""
        if not self.fuse:
            return sensors
        R = 1 / (1 / sensors.R).sum(0)
        return Sensors(((sensors.nu / sensors.R).sum(0) * R)[None], R[None], sensors.p)

    def factors(self, sensors: Sensors, h: Array, P: Array, *ahead: Array) -> Factors:
        nu, R, p = sensors
        alpha, u_alpha = self._measurement_factors(sensors)
        weights = (alpha if self.order == "alpha_first" else np.ones_like(alpha)) / R
        w = weights.sum(0)
        spread = 1 / w if self.u_cov == "inflated" else (weights**2 * R).sum(0) / w**2
        u = np.abs((weights * nu).sum(0)) / w / np.sqrt(p + spread)
        seen = {"u_alpha": u_alpha, "u_beta": u[None], "u_simplified": simplified_residual(sensors, 1 / R)[None]}
        return Factors(alpha, self._prediction_factor(u), seen)


@dataclass(frozen=True)
class SimplifiedDualFactorFilter(AdaptiveFactorFilter):
    """Dual factors with the simplified state residual (SDF): alpha as in DAF, beta from r = weighted mean of the
    innovations over sqrt(h' P- h).
    """

    mean: Annotated[Literal["nominal", "robust"], "weights of that mean: 1/R_i, or alpha_i/R_i"] = "nominal"
    states: Annotated[Literal["both", "measured"], "whether beta weakens all states, or the measured one only"] = "both"

    def factors(self, sensors: Sensors, h: Array, P: Array, *ahead: Array) -> Factors:
        alpha, u_alpha = self._measurement_factors(sensors)
        u = simplified_residual(sensors, (alpha if self.mean == "robust" else 1.0) / sensors.R)
        beta = self._prediction_factor(u)
        if self.states == "measured":
            beta = np.where((h != 0)[:, None], beta, 1.0)
        return Factors(alpha, beta, {"u_alpha": u_alpha, "u_beta": u[None]})


@dataclass(frozen=True)
class RobustAdaptiveFilter(AdaptiveFactorFilter):
    """Robust adaptive filter (RAF): a robust position X from the sensors alone, then beta from X - h'x-, then the
    weighted solution.

    Weights q_i = f(|y_i - X|/sqrt(R_i); lambda_alpha)/R_i, X = sum q_i y_i/sum q_i, repeated until they stay; alpha_i =
    f_i. beta = f(|X - h'x-|/s; lambda_beta), s^2 = h' P- h + sum q_i^2 R_i/(sum q_i)^2, or the trace of P- (which adds
    m^2 and m^2/s^2).
    """

    norm: Annotated[Literal["consistent", "trace"], "what standardises the prediction residual"] = "consistent"

    def factors(self, sensors: Sensors, h: Array, P: Array, *ahead: Array) -> Factors:
        nu, R, p = sensors
        log_f = ahead[0] if ahead else self.robust_weights(nu, np.broadcast_to(R, nu.shape))
        share = _shares(log_f, R)
        X = (share * nu).sum(0)
        variance = np.einsum("iim->m", P) if self.norm == "trace" else p + (share**2 * R).sum(0)
        u = np.abs(X) / np.sqrt(variance)
        alpha = np.maximum(np.exp(log_f), self.floor)
        seen = {"u_alpha": np.abs(nu - X) / np.sqrt(R), "u_beta": u[None]}
        return Factors(alpha, self._prediction_factor(u), seen)

    def prepared(self, model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> Iterator[recursion.Step]:
        """The steps, one after the other. The robust positions depend on the measurements alone: with all sensors
        there, those of all epochs are found at once.
        """
        if np.isnan(y).any():
            return super().prepared(model, y, x, P, Q, R)
        T, m, M = y.shape
        variances = np.broadcast_to(np.einsum("...iim->...im", R), y.shape)
        each, its = (A.swapaxes(0, 1).reshape(m, T * M) for A in (y, variances))
        with np.errstate(all="ignore"):
            log_f = self.robust_weights(each, its).reshape(m, T, M).swapaxes(0, 1)
        return recursion.steps(Ahead(self, log_f), model, y, x, P, Q, R)

    def robust_weights(self, y: Array, R: Array) -> Array:
        """log f_i of measurements, or innovations, y (m, M) with variances R (m, M) at the end of the iteration, which
        goes on only in the runs where one still changes.

        The factors stay logarithms: for a large gross error both plain weights may underflow to zero.
        """
        log_f = np.zeros_like(y)
        active, old = np.arange(y.shape[1]), log_f
        for _ in range(PASSES):
            q = np.exp(old - old.max(0)) / R
            new = log_factor((y - (q * y).sum(0) / q.sum(0)) / np.sqrt(R), self.lambda_alpha, self.factor)
            changed = (new != old).any(0)
            log_f[:, active] = new
            if not changed.any():
                break
            active, y, R, old = active[changed], y[:, changed], R[:, changed], new[:, changed]
        return log_f


@dataclass(frozen=True)
class Ahead:
    """A filter that is handed in every epoch what was found ahead of all of them, (T, m, M)."""

    filter: AdaptiveFactorFilter
    found: Array

    def predict(self, model: Model, x: Array, P: Array, k: int, Q: Array) -> tuple[Array, ...]:
        """The prediction of the filter, and what was found for this epoch."""
        return *self.filter.predict(model, x, P, k, Q), self.found[k - 1]

    def correct(self, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *ahead: Array) -> Posterior:
        """The update of the filter."""
        return self.filter.correct(model, x, P, y, k, R, *ahead)


def _shares(log_f: Array, R: Array) -> Array:
    """q_i/sum q for q_i = f_i/R_i, from log f_i."""
    q = np.exp(log_f - log_f.max(0)) / R
    return q / q.sum(0)


def skf() -> GaussianFilter:
    """Standard Kalman filter of the DAF paper: all factors 1."""
    return GaussianFilter(moments=Linear())
