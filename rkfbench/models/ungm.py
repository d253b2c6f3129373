"""The univariate non-stationary growth model, eq. (44) of the PEKF paper, where "x_{k-1,i}" is read as x_{k-1}.

The measurement hides the sign of the state, and its slope x/10 vanishes at 0: no linearisation learns anything there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np

from rkfbench.linalg import Array
from rkfbench.models.base import Smooth


@dataclass(frozen=True)
class UNGM(Smooth):
    """x_k = phi x + beta x/(1 + x^2) + gamma cos(1.2 (k - 1)) + w, y_k = x_k^2/20 + v, with x = x_{k-1}."""

    phi: Annotated[float, "decay of the state"] = 0.5
    beta: Annotated[float, "strength of the nonlinear growth"] = 25.0
    gamma: Annotated[float, "amplitude of the known periodic input"] = 8.0

    states: ClassVar[tuple[str, ...]] = ("x",)
    measurements: ClassVar[tuple[str, ...]] = ("y",)
    linear: ClassVar[bool] = False

    def f(self, x: Array, k: int) -> Array:
        return self.phi * x + self.beta * x / (1 + x * x) + self.gamma * np.cos(1.2 * (k - 1))

    def h(self, x: Array, k: int) -> Array:
        return x * x / 20

    def F(self, x: Array, k: int) -> Array:
        return (self.phi + self.beta * (1 - x * x) / (1 + x * x) ** 2)[None]

    def H(self, x: Array, k: int) -> Array:
        return (x / 10)[None]
