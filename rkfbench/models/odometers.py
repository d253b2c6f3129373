"""A car with several odometers: distance and speed by the constant-velocity model, every sensor measures the distance.

Source: the experiment of the DAF paper. The paper prints one measurement row A = [1 0]; here each sensor has a row of
its own, without which there are no separate factors for the sensors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Gt, MinLen

from rkfbench.linalg import Array
from rkfbench.models.base import Linear


@dataclass(frozen=True)
class Odometers(Linear):
    """x = [S, v]; S advances by dt v, v stays; each of the `sensors` measures S."""

    dt: Annotated[float, Gt(0), "time step in s"] = 1.0
    sensors: Annotated[tuple[str, ...], MinLen(1), "names of the sensors"] = ("A", "B")

    states: ClassVar[tuple[str, ...]] = ("S", "v")

    def __post_init__(self) -> None:
        if len(set(self.sensors)) < len(self.sensors):
            raise ValueError("a sensor is listed twice in 'sensors'")

    @property
    def measurements(self) -> tuple[str, ...]:
        return self.sensors

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array | None]:  # type: ignore[override]
        return np.array([[1.0, self.dt], [0.0, 1.0]]), np.tile([1.0, 0.0], (len(self.sensors), 1)), None
