"""Range and bearing of a point that does not move, from the origin of the plane: eq. (42) of the PEKF paper.

Without dynamics and process noise only the measurement update is put to the test.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rkfbench.linalg import Array
from rkfbench.models.bearing import Angle, Bearing, bearing_slopes


@dataclass(frozen=True)
class RangeBearing(Bearing):
    """x = [px, py] stays; y = [range sqrt(px^2 + py^2), bearing of (px, py)]."""

    angle: Angle = "atan2_wrap"

    states: ClassVar[tuple[str, ...]] = ("px", "py")
    measurements: ClassVar[tuple[str, ...]] = ("range", "bearing")
    bearings: ClassVar[tuple[int, ...]] = (1,)
    linear: ClassVar[bool] = False
    affine: ClassVar[bool] = True

    def f(self, x: Array, k: int) -> Array:
        return x

    def h(self, x: Array, k: int) -> Array:
        px, py = x
        return np.stack([np.sqrt(px * px + py * py), self.bearing(px, py)])

    def F(self, x: Array, k: int) -> Array:
        return np.eye(2)

    def H(self, x: Array, k: int) -> Array:
        px, py = x
        r = np.sqrt(px * px + py * py)
        return np.stack([np.stack([px / r, py / r]), np.stack(bearing_slopes(px, py))])
