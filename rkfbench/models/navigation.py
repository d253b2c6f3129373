"""Planar constant-velocity navigation: positions and velocities along two axes, some of them measured, with an
optional known input.

Source: eqs (78)-(79) of the ALADKF paper (dt = 0.5, px, py, vx measured) and eq. (32) of the FP-MCS paper (dt = 1,
positions measured, the input an acceleration under the heading theta).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Gt, MinLen

from rkfbench.linalg import Array
from rkfbench.models.base import Linear


@dataclass(frozen=True)
class Navigation(Linear):
    """x = [px, py, vx, vy]; p advances by dt v, v by dt u (sin theta, cos theta); the components in `observed` are
    measured.
    """

    dt: Annotated[float, Gt(0), "time step in s"] = 1.0
    observed: Annotated[
        tuple[Literal["px", "py", "vx", "vy"], ...], MinLen(1), "which states are measured, in this order"
    ] = ("px", "py")
    theta: Annotated[float, "heading of the known input, in rad from the y axis"] = np.pi / 6
    u: Annotated[float, "known constant input (acceleration along the heading)"] = 0.0

    states: ClassVar[tuple[str, ...]] = ("px", "py", "vx", "vy")

    def __post_init__(self) -> None:
        if len(set(self.observed)) < len(self.observed):
            raise ValueError("a state is listed twice in 'observed'")

    @property
    def measurements(self) -> tuple[str, ...]:
        return self.observed

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array | None]:  # type: ignore[override]
        F = np.kron([[1, self.dt], [0, 1]], np.eye(2))
        H = np.eye(4)[[self.states.index(name) for name in self.observed]]
        Bu = self.u * self.dt * np.array([0, 0, np.sin(self.theta), np.cos(self.theta)])
        return F, H, Bu if self.u else None
