"""What point smoothers are judged by: the filter's prior at the same step, the improvement over it, the runs that were
not lost.

A smoother of x_j and a filter answer to the same names: `mse@j` is the posterior of a filter at j and the last
estimate of a smoother, `mse_prior@j` the prior of
either. Improvements are those of the covariances that the smoother states, (33) of the FP-MCS paper; those of mean
square errors are ratios of means of `mse`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np

from rkfbench.linalg import Array
from rkfbench.metrics.base import Better, Each, Trial
from rkfbench.metrics.errors import SquaredError

Base = Annotated[Literal["prior", "post"], "the covariance before or after y_j"]


@dataclass(frozen=True)
class PriorSquaredError(Each):
    """Sum of the squared errors of the states before the update."""

    keep: ClassVar[frozenset[str]] = frozenset({"prior_mean"})
    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        prior, truth = trial.estimate.extras["prior_mean"], trial.truth()
        return np.asarray(sum((prior[:, i] - truth[:, i]) ** 2 for i in states))


@dataclass(frozen=True)
class Trace(Each):
    """Sum of the variances of the states that a smoother states: of its estimate, or of its filter's prior or
    posterior at j.
    """

    of: Literal["cov", "prior_cov", "post_cov"] = "cov"

    @property
    def keep(self) -> frozenset[str]:  # type: ignore[override]
        return frozenset({self.of})

    def applies(self, filt: Any) -> bool:
        """Smoothers only."""
        return getattr(filt, "target", None) is not None

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        P: Any = trial.estimate.cov if self.of == "cov" else trial.estimate.extras[self.of]
        return np.asarray(sum(P[:, i, i] for i in states))


@dataclass(frozen=True)
class Improvement(Each):
    """100 (1 - tr Pi / tr P_j) of the covariances Pi of a smoother, over the lag."""

    base: Base = "prior"

    @property
    def keep(self) -> frozenset[str]:  # type: ignore[override]
        return frozenset({"cov", f"{self.base}_cov", "post_cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        base: Literal["prior_cov", "post_cov"] = "prior_cov" if self.base == "prior" else "post_cov"
        return 100 * (1 - Trace()(trial, states) / Trace(base)(trial, states))


@dataclass(frozen=True)
class Distinct(Each):
    """Number of distinct copies of x_j that a particle smoother has left."""

    keep: ClassVar[frozenset[str]] = frozenset({"distinct"})
    better: ClassVar[Better | None] = "large"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return trial.estimate.extras["distinct"][:, 0]


def mse_prior() -> dict[str, Any]:
    """Squared error before the update: that of the prior mean."""
    return {"quantity": PriorSquaredError()}


def tracking_mse() -> dict[str, Any]:
    """Squared error over the runs that are not lost."""
    return {"quantity": SquaredError(), "tracking": True}


def kept_mse() -> dict[str, Any]:
    """What the runs that are not lost bring into the mean squared error: its mean with 0 in the lost ones."""
    return {"quantity": SquaredError(), "kept": True}


def trace(of: Annotated[Literal["cov", "prior_cov", "post_cov"], "which covariance"] = "cov") -> dict[str, Any]:
    """Trace of the covariance that a smoother states for its estimate, or of its filter's prior or posterior at j."""
    return {"quantity": Trace(of)}


def improvement(base: Base = "prior") -> dict[str, Any]:
    """Improvement in % of the covariance that a smoother states over that of its filter at j: 100 (1 - tr Pi / tr
    P_j).
    """
    return {"quantity": Improvement(base)}


def distinct() -> dict[str, Any]:
    """Number of distinct copies of x_j that a particle smoother has left."""
    return {"quantity": Distinct()}
