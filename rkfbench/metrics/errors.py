"""Errors of the estimate: estimate minus truth, after the update, at every step; no burn-in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rkfbench.linalg import Array
from rkfbench.metrics.base import RECORD, Better, Each, Trial, outliers


@dataclass(frozen=True)
class SquaredError(Each):
    """Sum of the squared errors of the states: sum_i (xhat_i - x_i)^2."""

    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        total = np.zeros(())
        for i in states:
            total = total + (trial.estimate.mean[:, i] - trial.truth()[:, i]) ** 2
        return total


@dataclass(frozen=True)
class SquaredErrorWhere(SquaredError):
    """The squared error at the steps whose measurement has an outlier, or has none; NaN at the others."""

    where: str = "outlier"
    needs: ClassVar[frozenset[str]] = RECORD

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.where(outliers(trial) == (self.where == "outlier"), super().__call__(trial, states), np.nan)


@dataclass(frozen=True)
class ErrorNorm(SquaredError):
    """Euclidean norm of the error, eq. (82) of the ALADKF paper over the states named (all n = 4 by default)."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.sqrt(super().__call__(trial, states))


@dataclass(frozen=True)
class AbsoluteError(SquaredError):
    """Largest absolute error among the states."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.abs(trial.estimate.mean[:, states] - trial.truth()[:, states]).max(1)
