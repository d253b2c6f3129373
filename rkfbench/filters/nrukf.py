"""The filters of the NRUKF paper by name: Huber regression on linear, linearised and statistically linearised models,
and the NRUKF in its two forms.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Annotated, Literal

from rkfbench.filters import recursion
from rkfbench.filters.base import Estimate, Known, Posterior
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear, Taylor
from rkfbench.filters.regression import LinearisationCov, Passes, Regression, Root, StateRows, Threshold
from rkfbench.filters.residual_weights import PseudoObservation, ResidualHuber, Reweighted
from rkfbench.filters.sigma import DividedDifference, Unscented
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.streams import Streams

Kappa = Annotated[float | Literal["3-n"], "spread of the unscented points, n + kappa > 0"]
Interval2 = Annotated[float, "squared interval length h^2 of the divided differences, above 1"]
Member = Literal["ukf", "nrukf_r", "nrukf_y", "nrukf_r_it"]


def hkf_regression(
    threshold: Threshold = 1.345, state_rows: StateRows = "weighted", root: Root = "cholesky", passes: Passes = 10
) -> GaussianFilter:
    """Huber Kalman filter as an M-estimate over measurement and state rows, for a linear model."""
    return GaussianFilter(Linear(), update=Regression(threshold, state_rows, root, passes))


def hekf(
    threshold: Threshold = 1.345,
    state_rows: StateRows = "weighted",
    root: Root = "cholesky",
    passes: Passes = 10,
    linearisation_cov: LinearisationCov = False,
) -> GaussianFilter:
    """Huber extended Kalman filter: the regression with the Jacobian of h at the prediction."""
    return GaussianFilter(Taylor(), update=Regression(threshold, state_rows, root, passes, linearisation_cov))


def hukf(
    threshold: Threshold = 1.345,
    state_rows: StateRows = "weighted",
    root: Root = "cholesky",
    passes: Passes = 10,
    linearisation_cov: LinearisationCov = False,
    kappa: Kappa = "3-n",
) -> GaussianFilter:
    """Huber unscented Kalman filter: the regression with the statistical slope H = Pxz' (P-)^-1 of unscented
    moments.
    """
    return GaussianFilter(
        Unscented(kappa=kappa), update=Regression(threshold, state_rows, root, passes, linearisation_cov)
    )


def hukf0(
    threshold: Threshold = 1.345, passes: Passes = 10, linearisation_cov: LinearisationCov = False, kappa: Kappa = "3-n"
) -> GaussianFilter:
    """Huber unscented Kalman filter with state rows of weight 1: only the measurement is weighted."""
    return hukf(threshold, "unit", "cholesky", passes, linearisation_cov, kappa)


def hddf(
    threshold: Threshold = 1.345,
    state_rows: StateRows = "weighted",
    root: Root = "cholesky",
    passes: Passes = 10,
    linearisation_cov: LinearisationCov = False,
    h2: Interval2 = 3.0,
) -> GaussianFilter:
    """Huber divided-difference filter: the regression with the statistical slope of second-order divided
    differences.
    """
    return GaussianFilter(
        DividedDifference(h2=h2), update=Regression(threshold, state_rows, root, passes, linearisation_cov)
    )


def nrukf_r(threshold: Threshold = 1.345, kappa: Kappa = "3-n") -> GaussianFilter:
    """Novel robust unscented Kalman filter, R form: R inflated by Huber's weight of (y - h(x-))/sqrt(R), then the plain
    unscented update.
    """
    return GaussianFilter(Unscented(kappa=kappa), ResidualHuber(threshold))


def nrukf_y(threshold: Threshold = 1.345, kappa: Kappa = "3-n") -> GaussianFilter:
    """Novel robust unscented Kalman filter, Y form: the measurement truncated to h(x-) +- gamma sqrt(R), then the plain
    unscented update.
    """
    return GaussianFilter(Unscented(kappa=kappa), PseudoObservation(threshold))


def nrukf_r_it(threshold: Threshold = 1.345, passes: Passes = 10, kappa: Kappa = "3-n") -> GaussianFilter:
    """NRUKF in R form, repeated with the residual at the newest posterior mean."""
    return GaussianFilter(Unscented(kappa=kappa), ResidualHuber(threshold), Reweighted(passes))


def nrukf_y_it(threshold: Threshold = 1.345, passes: Passes = 30, kappa: Kappa = "3-n") -> GaussianFilter:
    """NRUKF in Y form, repeated with the residual at the newest posterior mean; it converges more slowly than the R
    form.
    """
    return GaussianFilter(Unscented(kappa=kappa), PseudoObservation(threshold), Reweighted(passes))


@dataclass(frozen=True)
class Swap:
    """The posterior mean of one unscented filter with the posterior covariance of another, both from one prior: which
    of the two makes the difference?
    """

    mean: Annotated[Member, "filter whose mean is taken"] = "nrukf_r"
    cov: Annotated[Member, "filter whose covariance is taken"] = "ukf"
    threshold: Threshold = 1.345

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return recursion.SEES - {"nu", "S"}

    def check(self, model: Model) -> None:
        """SpecError if the unscented rule has no points for the model."""
        self._member("ukf").check(model)

    def _member(self, name: Member) -> GaussianFilter:
        if name == "ukf":
            return GaussianFilter(Unscented())
        make: dict[str, Callable[..., GaussianFilter]]
        make = {"nrukf_r": nrukf_r, "nrukf_y": nrukf_y, "nrukf_r_it": nrukf_r_it}
        return make[name](threshold=self.threshold)

    def predict(self, model: Model, x: Array, P: Array, k: int, Q: Array) -> tuple[Array, ...]:
        """The common prediction."""
        return self._member("ukf").predict(model, x, P, k, Q)

    def correct(self, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *points: Array) -> Posterior:
        """Mean and covariance of the two updates."""
        x, P = (
            self._member(self.mean).correct(model, x, P, y, k, R, *points).x,
            self._member(self.cov).correct(model, x, P, y, k, R, *points).P,
        )
        return Posterior(x, P, {})

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
        return recursion.run(self, model, y, x0, P0, Q, R, keep)
