"""Altitude-aided tracking from the origin, eqs (45)-(49) of the PEKF paper: a target of nearly constant velocity in
space.

(48) divides by r_k, which (46) defines as the noisy range; the noise-free one is meant. At ground range 0 the bearing
is undefined and its slope infinite.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Gt

from rkfbench.linalg import Array, mul
from rkfbench.models.bearing import Angle, Bearing, bearing_slopes


@dataclass(frozen=True)
class Altitude(Bearing):
    """x = [p, v], p advances by dt v; y = [bearing of (px, py), range |p|, height pz, range rate p'v/|p|]."""

    dt: Annotated[float, Gt(0), "time step in s"] = 1.0
    angle: Angle = "atan2_wrap"

    states: ClassVar[tuple[str, ...]] = ("px", "py", "pz", "vx", "vy", "vz")
    measurements: ClassVar[tuple[str, ...]] = ("bearing", "range", "height", "range_rate")
    bearings: ClassVar[tuple[int, ...]] = (0,)
    linear: ClassVar[bool] = False
    affine: ClassVar[bool] = True

    def f(self, x: Array, k: int) -> Array:
        return mul(self.matrix, x)

    def h(self, x: Array, k: int) -> Array:
        px, py, pz, vx, vy, vz = x
        r = np.sqrt(px * px + py * py + pz * pz)
        return np.stack([self.bearing(px, py), r, pz, (px * vx + py * vy + pz * vz) / r])

    @cached_property
    def matrix(self) -> Array:
        """F (6, 6)."""
        return np.kron([[1.0, self.dt], [0.0, 1.0]], np.eye(3))

    def F(self, x: Array, k: int) -> Array:
        return self.matrix

    def H(self, x: Array, k: int) -> Array:
        p, v = x[:3], x[3:]
        r = np.sqrt((p * p).sum(0))
        u = p / r
        H = np.zeros((4, 6, *x.shape[1:]))
        H[0, 0], H[0, 1] = bearing_slopes(p[0], p[1])
        H[1, :3] = H[3, 3:] = u
        H[2, 2] = 1.0
        H[3, :3] = (v - (u * v).sum(0) * u) / r
        return H
