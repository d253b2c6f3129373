"""A scripted drive along a road: constant speed, with one time of constant acceleration in between.

Source: working modes 1 and 2 of the car of the DAF paper. Its mode 2 says that the speed is 20 m/s again right after 50
s of acceleration; taken literally (`reset`) the speed jumps at that moment, physically (`keep`) it stays where the
acceleration left it. The distance is continuous in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge, Gt

from rkfbench.errors import SpecError
from rkfbench.linalg import Array


@dataclass(frozen=True)
class Drive:
    """Distance and speed (S, v) with acceleration a for start <= t < start + duration: v = v0 + a (t - start), S = S0 +
    integral of v.
    """

    initial: Annotated[tuple[float, float], "distance in m and speed in m/s at t = 0"] = (0.0, 20.0)
    acceleration: Annotated[float, "in m/s^2"] = 0.0
    start: Annotated[float, Ge(0), "time in s at which the acceleration begins"] = 500.0
    duration: Annotated[float, Ge(0), "how long it lasts, in s"] = 50.0
    ending: Annotated[Literal["reset", "keep"], "the speed after it: as before, or as it left it"] = "reset"
    dt: Annotated[float, Gt(0), "time step in s"] = 1.0

    @property
    def manoeuvre(self) -> tuple[int, int]:
        """The last step before the acceleration and the first one after it."""
        return int(np.floor(self.start / self.dt)), int(np.ceil((self.start + self.duration) / self.dt))

    def check(self, states: tuple[str, ...]) -> None:
        """SpecError unless the model's states are distance and speed."""
        if tuple(states) != ("S", "v"):
            raise SpecError(f"the script gives the states S, v; the model has {', '.join(states)}")

    def states(self, steps: int) -> Array:
        """(S, v) at t = dt, 2 dt, ..., (steps, 2)."""
        t = self.dt * np.arange(1, steps + 1)
        S0, v0 = self.initial
        during = np.clip(t - self.start, 0.0, self.duration)
        past = np.maximum(t - self.start - self.duration, 0.0)
        gained = self.acceleration * self.duration if self.ending == "keep" else 0.0
        accelerating = t < self.start + self.duration
        speed = v0 + np.where(accelerating, self.acceleration * during, gained)
        distance = S0 + v0 * t + 0.5 * self.acceleration * during**2 + gained * past
        return np.column_stack([distance, speed])
