"""Bearings: the ways in which papers write and codes compute the direction of a point of the plane from the origin.

    atan2_wrap   atan2(y, x); differences of bearings are wrapped to [-pi, pi)
    atan2_raw    atan2(y, x); differences are left as they are, so a crossing of the cut is an innovation of about 2 pi
    atan_wrap    atan(y/x), which cannot tell opposite directions; differences are wrapped with period pi
    atan_raw     atan(y/x); differences are left as they are

The choice rules the measurements that are simulated and what the filters believe of them. The Jacobian is the same for
all four.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

import numpy as np

from rkfbench.linalg import Array
from rkfbench.models.base import wrap

Angle = Annotated[
    Literal["atan2_wrap", "atan2_raw", "atan_wrap", "atan_raw"],
    "how bearings are computed, and whether their differences are wrapped",
]


class Bearing:
    """The residual of a model whose first measurements are bearings as `angle` says."""

    angle: Angle
    bearings: ClassVar[tuple[int, ...]]  # which measurements are bearings

    @property
    def angles(self) -> tuple[int, ...]:
        """The measurements whose differences are wrapped."""
        return self.bearings if self.angle.endswith("wrap") else ()

    def bearing(self, px: Array, py: Array) -> Array:
        """Direction of (px, py) from the origin."""
        if self.angle.startswith("atan2"):
            return np.arctan2(py, px)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.arctan(py / px)

    def residual(self, y: Array, z: Array) -> Array:
        """y - z, with bearings wrapped where `angle` says so."""
        difference = y - z
        for i in self.angles:
            difference[i] = wrap(difference[i], np.pi if self.angle.startswith("atan_") else 2 * np.pi)
        return difference


def bearing_slopes(px: Array, py: Array) -> tuple[Array, Array]:
    """Derivatives of the bearing: -py/(px^2 + py^2), px/(px^2 + py^2)."""
    square = px * px + py * py
    return -py / square, px / square
