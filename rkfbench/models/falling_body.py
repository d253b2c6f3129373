"""A body falling through the atmosphere, seen by a range radar: altitude x1 (ft), downward speed x2 (ft/s), ballistic
coefficient x3 (1/ft).

    x1' = -x2,   x2' = -x2^2 x3 exp(-gamma x1),   x3' = 0;      y = sqrt(dr^2 + (x1 - ar)^2) + v

Source: Athans, Wishner and Bertolini (1968). The NRUKF paper says no more of its example than "target tracking"; this
one is a labelled reconstruction. Between measurements x is integrated by Runge-Kutta steps of order four, the same for
the truth and for the filters, and the Jacobian F by the same steps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge, Gt
from numpy.typing import NDArray

from rkfbench.linalg import Array
from rkfbench.models.base import Smooth

BOUNDS = np.array([[1e7], [1e6], [10.0]])  # |x| beyond these is no falling body any more
MOST_VARIANCE = 1e16


@dataclass(frozen=True)
class FallingBody(Smooth):
    """x = [altitude, speed, ballistic]; the range to a radar at horizontal distance dr and altitude ar is measured."""

    dt: Annotated[float, Gt(0), "time between measurements in s"] = 0.1
    rk4_steps: Annotated[int, Ge(1), "integration steps between two measurements"] = 2
    distance: Annotated[float, "horizontal distance dr of the radar in ft"] = 1e5
    height: Annotated[float, "altitude ar of the radar in ft"] = 1e5
    decay: Annotated[float, "decay gamma of the air density with altitude in 1/ft"] = 5e-5

    states: ClassVar[tuple[str, ...]] = ("altitude", "speed", "ballistic")
    measurements: ClassVar[tuple[str, ...]] = ("range",)
    linear: ClassVar[bool] = False

    def f(self, x: Array, k: int) -> Array:
        """The state dt later."""
        step = self.dt / self.rk4_steps
        altitude, speed, ballistic = x
        for _ in range(self.rk4_steps):
            altitude, speed = _runge_kutta(self._rates, step, altitude, speed, ballistic)
        return np.stack([altitude, speed, ballistic])

    def F(self, x: Array, k: int) -> Array:
        """The Jacobian of f: d Phi/dt = J Phi by the same Runge-Kutta steps."""
        step = self.dt / self.rk4_steps
        altitude, speed, ballistic = x
        Phi = np.zeros((3, 3, *x.shape[1:]))
        Phi[0, 0] = Phi[1, 1] = Phi[2, 2] = 1.0
        rows: tuple[Array, ...] = (altitude, speed, Phi[0], Phi[1])
        for _ in range(self.rk4_steps):
            rows = _runge_kutta(self._tangent_rates, step, *rows, ballistic)
        Phi[0], Phi[1] = rows[2:]
        return Phi

    def _rates(self, altitude: Array, speed: Array, ballistic: Array) -> tuple[Array, Array]:
        return -speed, -(speed * speed) * ballistic * np.exp(-self.decay * altitude)

    def _tangent_rates(
        self, altitude: Array, speed: Array, Phi1: Array, Phi2: Array, ballistic: Array
    ) -> tuple[Array, ...]:
        """Rates of altitude and speed and of the first two rows of Phi; the third row of Phi stays (0, 0, 1)."""
        drag = speed * np.exp(-self.decay * altitude)
        J21, J22, J23 = self.decay * speed * ballistic * drag, -2 * ballistic * drag, -speed * drag
        second = J21 * Phi1 + J22 * Phi2
        second[2] += J23
        return -speed, -speed * ballistic * drag, -Phi2, second

    def h(self, x: Array, k: int) -> Array:
        """The range."""
        return np.sqrt(self.distance**2 + (x[:1] - self.height) ** 2)

    def H(self, x: Array, k: int) -> Array:
        """(x1 - ar)/h and zeros."""
        H = np.zeros((1, 3, *x.shape[1:]))
        H[0, 0] = (x[0] - self.height) / self.h(x, k)[0]
        return H

    def plausible(self, x: Array, P: Array) -> NDArray[np.bool_]:
        """Whether an estimate is still about a falling body: far below overflow, but out of reach of any sound run."""
        inside = (np.abs(x) <= BOUNDS).all(0)
        return np.asarray(inside & (np.einsum("iim->im", P) <= MOST_VARIANCE).all(0))


def _runge_kutta(rates, step: float, *arguments: Array) -> tuple[Array, ...]:  # type: ignore[no-untyped-def]
    """One step of order four of all arguments but the last, which stays."""
    *z, fixed = arguments

    def moved(rate: tuple[Array, ...], by: float) -> list[Array]:
        return [zi + by * ri for zi, ri in zip(z, rate, strict=True)]

    k1 = rates(*z, fixed)
    k2 = rates(*moved(k1, step / 2), fixed)
    k3 = rates(*moved(k2, step / 2), fixed)
    k4 = rates(*moved(k3, step), fixed)
    return tuple(zi + step / 6 * (a + 2 * (b + c) + d) for zi, a, b, c, d in zip(z, k1, k2, k3, k4, strict=True))
