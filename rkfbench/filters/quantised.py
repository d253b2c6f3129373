"""A filter whose measurements are rounded to a grid before it sees them: does a robust filter mind many small
errors?
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from annotated_types import Gt

from rkfbench.filters.base import Estimate, Known, Setting
from rkfbench.filters.smoothing import inner_filter, placed
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.streams import Streams

GridStep = Annotated[float, Gt(0), "distance of the values that the sensor can give, in its own units"]


@dataclass(frozen=True)
class Quantised:
    """Another filter, given step * round(y / step) in the place of y."""

    filter: Any
    step: float

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep: those of the filter."""
        return getattr(self.filter, "sees", frozenset())

    @property
    def target(self) -> int | None:
        """The step that a smoother of one point estimates."""
        target: int | None = getattr(self.filter, "target", None)
        return target

    @property
    def lag(self) -> int:
        """The measurements after it that such a smoother uses, at most."""
        lag: int = self.filter.lag
        return lag

    def check(self, model: Model) -> None:
        """SpecError if the filter cannot run on this model."""
        if hasattr(self.filter, "check"):
            self.filter.check(model)

    def check_told(self, Q: Array, R: Array) -> None:
        """SpecError if the filter cannot use what it is told."""
        if hasattr(self.filter, "check_told"):
            self.filter.check_told(Q, R)

    def placed(self, setting: Setting) -> Quantised:
        """The same around the filter as it is placed in an experiment."""
        return replace(self, filter=placed(self.filter, setting))

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
        rounded = self.step * np.round(np.asarray(y, dtype=float) / self.step)
        estimate: Estimate = self.filter.run(model, rounded, x0, P0, Q=Q, R=R, keep=keep, known=known, streams=streams)
        return estimate


def quantised(
    filter: Annotated[Any, "the filter, in any form that a scenario may write"] = "ukf", step: GridStep = 1.0
) -> Quantised:
    """A filter whose measurements are rounded to multiples of a step before it sees them."""
    return Quantised(inner_filter(filter), step)
