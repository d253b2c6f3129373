"""Numbers from what a filter shows of itself: factors, weights, standardised residuals, last changes of an iteration.

The history is named in the metric, `mean_of(name=u_beta)` or `share_below(name=alpha, component=A, limit=1)`, and a
filter that does not keep it has no such number. Of a history with several components any one counts (a share), or their
mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from rkfbench.errors import SpecError, did_you_mean
from rkfbench.filters.histories import components
from rkfbench.linalg import Array
from rkfbench.metrics.base import Each, Trial, mean_where, outliers
from rkfbench.models import Model


@dataclass(frozen=True)
class Shown(Each):
    """A kept history (T, d, M), or one component of it, by the name of the measurement or state."""

    name: str = ""
    component: str = ""

    @property
    def keep(self) -> frozenset[str]:  # type: ignore[override]
        return frozenset({self.name})

    def check(self, model: Model) -> None:
        """SpecError if the model has no such component."""
        names = (*model.measurements, *model.states)
        if self.component and self.component not in names:
            raise SpecError(f"the model has no component '{self.component}'{did_you_mean(self.component, names)}")

    def values(self, trial: Trial) -> Array:
        """The history with the components wanted, (T, d or 1, M)."""
        values = trial.estimate.extras[self.name]
        if not self.component:
            return values
        names = components(self.name, values.shape[1], trial.experiment.model)
        if self.component not in names:
            return np.full((len(values), 1, values.shape[2]), np.nan)
        return values[:, [list(names).index(self.component)]]


@dataclass(frozen=True)
class MeanOf(Shown):
    """The mean over the components that are there; NaN at the steps that do not count, or without any."""

    which: Literal["all", "outlier", "clean"] = "all"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        mean = mean_where(self.values(trial), axis=1)
        return mean if self.which == "all" else np.where(outliers(trial) == (self.which == "outlier"), mean, np.nan)


@dataclass(frozen=True)
class Beyond(Shown):
    """1 where any component lies below the limit (or above it), else 0; NaN where there is none."""

    limit: float = 1.0
    above: bool = False

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        values = self.values(trial)
        beyond = (values > self.limit if self.above else values < self.limit).any(1)
        return np.where(np.isnan(values).all(1), np.nan, beyond)
