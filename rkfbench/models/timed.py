"""A model with a time step of its own at each k: what a recording with irregular times needs."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

from rkfbench.errors import SpecError
from rkfbench.linalg import Array


class Timed:
    """x_k = f(x_{k-1}; dt_k): a model that has a parameter `dt`, which is intervals[k - 1] at step k."""

    def __init__(self, model: Any, intervals: Array) -> None:
        self.model, self.intervals = model, intervals
        self._at = {dt: replace(model, dt=dt) for dt in set(intervals.tolist())}

    def __getattr__(self, name: str) -> Any:
        return getattr(self.__dict__["model"], name)

    def f(self, x: Array, k: int) -> Array:
        return self._at[float(self.intervals[k - 1])].f(x, k)

    def F(self, x: Array, k: int) -> Array:
        return self._at[float(self.intervals[k - 1])].F(x, k)

    @property
    def matrices(self) -> Any:
        """A linear model of constant matrices it is not."""
        raise SpecError("needs constant matrices F and H, which irregular time steps do not have")


def has_dt(model: Any) -> bool:
    """Whether a time step can be given to the model."""
    return is_dataclass(model) and any(field.name == "dt" for field in fields(model))
