"""The factor lambda of (38), and how well it tells outliers from clean measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rkfbench.linalg import Array
from rkfbench.metrics.base import Better, Each, Trial, outliers


@dataclass(frozen=True)
class Lambda(Each):
    """lambda at each step."""

    keep: ClassVar[frozenset[str]] = frozenset({"lambda"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return trial.estimate.extras["lambda"][:, 0]


@dataclass(frozen=True)
class LambdaAuc(Lambda):
    """Area under the ROC curve of lambda against the outlier flag, one number a run: P(lambda of an outlier > lambda
    of a clean measurement).

    By ranks (Mann-Whitney); NaN in a run without outliers or without clean measurements.
    """

    of_run: ClassVar[bool] = True
    better: ClassVar[Better | None] = "large"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        flags = outliers(trial)
        ranks = np.argsort(np.argsort(super().__call__(trial, states), axis=0, kind="stable"), axis=0) + 1.0
        dirty, T = flags.sum(0), len(flags)
        return (((ranks * flags).sum(0) - dirty * (dirty + 1) / 2) / (dirty * (T - dirty)))[None]


@dataclass(frozen=True)
class OutlierRate(Lambda):
    """Share of outliers among the steps of one fifth of lambda, fifth 1 being the smallest: 1 or 0 at those steps."""

    fifth: int = 5
    of_run: ClassVar[bool] = True

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        order = np.argsort(super().__call__(trial, states), axis=0, kind="stable")
        T = len(order)
        steps = order[(self.fifth - 1) * T // 5 : self.fifth * T // 5]
        return np.take_along_axis(outliers(trial), steps, axis=0).astype(float)
