"""Numerical conditioning of the innovation covariance S, eqs (42)-(58) of the ALADKF paper, and the Huber factors
behind it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from rkfbench.filters.base import Estimate
from rkfbench.filters.weights import Huber, recolour
from rkfbench.linalg import Array, batched, cond, whitening
from rkfbench.metrics.base import RECORD, Better, Each, Trial, outliers, over_time

Which = Literal["all", "outlier", "clean", "worse", "single"]
EXTREME = 10  # times the threshold of Huber's function, at which a residual is extreme
ROUNDING = 1e-9  # relative margin of `worse`: the rounding of cond(S) is about 1e-16 cond(S), and a few units here


@dataclass(frozen=True)
class ConditionS(Each):
    """Condition number of S in the 2-norm: largest over smallest eigenvalue of (42)-(44)."""

    keep: ClassVar[frozenset[str]] = frozenset({"S"})
    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return condition_of(trial.estimate)


@dataclass(frozen=True)
class ConditionTopLambda(Each):
    """cond(S) at the steps of each run at which the factor lambda of the filter `by` is largest."""

    by: str = "aladkf"
    count: int = 25
    keep: ClassVar[frozenset[str]] = frozenset({"S"})
    of_run: ClassVar[bool] = True

    @property
    def partners(self) -> Mapping[str, frozenset[str]]:  # type: ignore[override]
        return {self.by: frozenset({"lambda"})}

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        by = trial.others[self.by]
        known = f"steps of the {self.count} largest lambda"  # for every filter the same ones
        if known not in by.derived:
            by.derived[known] = largest(by.extras["lambda"][:, 0], self.count)
        return at(by.derived[known], condition_of(trial.estimate))


@dataclass(frozen=True)
class ConditionRatioTopPsi(Each):
    """cond(S) over that of the filter `over`, at the steps of each run at which cond(Psi) is largest."""

    over: str = "kf"
    count: int = 25
    keep: ClassVar[frozenset[str]] = frozenset({"S", "inflation"})
    of_run: ClassVar[bool] = True

    @property
    def partners(self) -> Mapping[str, frozenset[str]]:  # type: ignore[override]
        return {self.over: frozenset({"S"})}

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        ratio = condition_of(trial.estimate) / condition_of(trial.others[self.over])
        return at(largest(psi_condition(trial.estimate), self.count), ratio)


@dataclass(frozen=True)
class Premise(Each):
    """1 where (46) holds: cond(Psi^(-1/2)) = sqrt(max Phi/min Phi) >= cond(R), else 0; NaN at the steps left out.

    Steps: all, those with an outlier, the clean ones, those at which cond(S) is worse than that of the filter `than`,
    or those with one extreme residual alone (the others within the threshold), of which the paper speaks after (57).
    Never those with a missing component.
    """

    which: Which = "all"
    than: str = "kf"
    keep: ClassVar[frozenset[str]] = frozenset({"S", "inflation"})

    @property
    def needs(self) -> frozenset[str]:
        return RECORD if self.which in ("outlier", "clean") else frozenset()

    @property
    def partners(self) -> Mapping[str, frozenset[str]]:  # type: ignore[override]
        return {self.than: frozenset({"S"})} if self.which == "worse" else MappingProxyType({})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        known = np.isfinite(trial.estimate.extras["inflation"]).all(1)
        holds = np.where(known, self.holds(trial), np.nan)
        if self.which == "worse":
            return np.where(worse(trial, self.than), holds, np.nan)
        if self.which == "single":
            return np.where(single(trial.estimate), holds, np.nan)
        if self.which == "all":
            return holds
        return np.where(outliers(trial) == (self.which == "outlier"), holds, np.nan)

    def holds(self, trial: Trial) -> NDArray[np.bool_]:
        """Where (46) holds, (T, M)."""
        return premise(trial)


@dataclass(frozen=True)
class Conclusion(Premise):
    """1 where (47) holds, which (46) is enough for: cond(R_h) >= cond(R), but for rounding, with the inflated R_h = L
    Psi^-1 L'; else 0.
    """

    def applies(self, filt: object) -> bool:
        """Whether the filter inflates R by Huber's function."""
        return isinstance(getattr(filt, "weight", None), Huber)

    def holds(self, trial: Trial) -> NDArray[np.bool_]:
        """Where (47) holds, (T, M)."""
        R = batched(trial.assumed.R)
        L, _ = whitening(R, trial.filter.weight.root)
        inflated = over_time(lambda phi: cond(recolour(L, phi)), trial.estimate.extras["inflation"])
        return np.asarray(inflated >= cond(R)[0] * (1 - ROUNDING))


@dataclass(frozen=True)
class WorseGivenPremise(Each):
    """1 where cond(S) is worse than that of the filter `than`, else 0; NaN at the steps where (46) does not hold."""

    than: str = "kf"
    keep: ClassVar[frozenset[str]] = frozenset({"S", "inflation"})

    @property
    def partners(self) -> Mapping[str, frozenset[str]]:  # type: ignore[override]
        return {self.than: frozenset({"S"})}

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.where(premise(trial), worse(trial, self.than), np.nan)


def condition_of(estimate: Estimate) -> Array:
    """cond(S) at all steps, (T, M or 1); computed once for an estimate, since many metrics look at it."""
    if "cond_S" not in estimate.derived:
        estimate.derived["cond_S"] = over_time(cond, estimate.extras["S"])
    return estimate.derived["cond_S"]


def psi_condition(estimate: Estimate) -> Array:
    """cond(Psi) = max Phi/min Phi of the Huber factors, (T, M)."""
    inflation = estimate.extras["inflation"]
    return inflation.max(1) / inflation.min(1)


def premise(trial: Trial) -> NDArray[np.bool_]:
    """Where (46) holds, (T, M)."""
    return np.sqrt(psi_condition(trial.estimate)) >= cond(batched(trial.assumed.R))[0]


def single(estimate: Estimate) -> NDArray[np.bool_]:
    """Where one residual is extreme and the others are within the threshold, (T, M)."""
    inflation = estimate.extras["inflation"]
    return (inflation.max(1) > EXTREME) & ((inflation > 1).sum(1) == 1)


def worse(trial: Trial, than: str) -> NDArray[np.bool_]:
    """Where cond(S) exceeds that of another filter by more than rounding, (T, M).

    Where no residual is inflated the HKF is the KF, with the same S but for the last bits; chance must not decide.
    """
    return condition_of(trial.estimate) > condition_of(trial.others[than]) * (1 + ROUNDING)


def largest(size: Array, count: int) -> NDArray[np.intp]:
    """The `count` steps of each run at which `size` (T, M) is largest, (count, M)."""
    return np.argsort(-size, axis=0, kind="stable")[:count]


def at(steps: NDArray[np.intp], values: Array) -> Array:
    """The values (T, M or 1) at some steps (count, M) of each run."""
    return np.take_along_axis(np.broadcast_to(values, (len(values), steps.shape[1])), steps, axis=0)
