"""What a state-space model is: x_k = f(x_{k-1}) + w_k, y_k = h(x_k) + v_k, with named components and Jacobians.

States and measurements keep their components on the first axis and may carry any axes behind it, so the same f serves
one state, all runs (n, M), sigma points (n, S, M) and particles (n, M, N). A model knows its equations, not its noise,
its filters or its experiment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import numpy as np

from rkfbench.linalg import Array, mul


class Model(Protocol):
    """A state-space model. k is the step that is reached (f, F) or measured (h, H), k = 1..T."""

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the n components of the state."""
        ...

    @property
    def measurements(self) -> tuple[str, ...]:
        """Names of the m components of the measurement."""
        ...

    @property
    def linear(self) -> bool:
        """Whether f and h are linear, with the constant matrices F and H."""
        ...

    def f(self, x: Array, k: int) -> Array:
        """The state at k from the state at k-1, without noise: (n, ...) -> (n, ...)."""
        ...

    def h(self, x: Array, k: int) -> Array:
        """The measurement of x without noise: (n, ...) -> (m, ...)."""
        ...

    def F(self, x: Array, k: int) -> Array:
        """Jacobian of f at x (n, M): (n, n) if it is the same everywhere, else (n, n, M)."""
        ...

    def H(self, x: Array, k: int) -> Array:
        """Jacobian of h at x (n, M): (m, n) if it is the same everywhere, else (m, n, M)."""
        ...

    def residual(self, y: Array, z: Array) -> Array:
        """y - z, with angles wrapped to [-pi, pi)."""
        ...


def wrap(angle: Array, period: float = 2 * np.pi) -> Array:
    """The angle in [-period/2, period/2), but for rounding at its ends; unchanged if it lies there."""
    half = period / 2
    if angle.size and angle.min() >= -half and angle.max() < half * (1 - 1e-15):  # as below, to the last bit
        return angle
    return angle - period * np.floor((angle + half) / period)


class Smooth:
    """The residual of every model: a plain difference, but for the components listed in `angles`. Not linear, unless a
    subclass says so; `affine` says of f alone that it is F x + b, with an F that does not depend on x.
    """

    angles: ClassVar[tuple[int, ...]] = ()
    linear: ClassVar[bool] = False
    affine: ClassVar[bool] = False

    def residual(self, y: Array, z: Array) -> Array:
        """y - z, with the components in `angles` wrapped to [-pi, pi)."""
        difference = y - z
        for i in self.angles:
            difference[i] = wrap(difference[i])
        return difference


class Linear(Smooth):
    """x_k = F x_{k-1} + B u, y_k = H x_k.

    A subclass gives `matrices`: F (n, n), H (m, n) and the input Bu (n,) or None.
    """

    linear: ClassVar[bool] = True
    affine: ClassVar[bool] = True
    matrices: tuple[Array, Array, Array | None]

    def f(self, x: Array, k: int) -> Array:
        F, _, Bu = self.matrices
        reached = mul(F, x)
        return reached if Bu is None else reached + Bu.reshape(-1, *(1,) * (x.ndim - 1))

    def h(self, x: Array, k: int) -> Array:
        return mul(self.matrices[1], x)

    def F(self, x: Array, k: int) -> Array:
        return self.matrices[0]

    def H(self, x: Array, k: int) -> Array:
        return self.matrices[1]


class Observed:
    """A model seen through some of its measurement components: the others are missing at this step."""

    def __init__(self, model: Model, rows: Sequence[int] | Array) -> None:
        self.model, self.rows = model, np.asarray(rows, dtype=np.intp)
        self.measurements = tuple(model.measurements[i] for i in self.rows)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.model, name)

    def h(self, x: Array, k: int) -> Array:
        return self.model.h(x, k)[self.rows]

    def H(self, x: Array, k: int) -> Array:
        return self.model.H(x, k)[self.rows]

    def residual(self, y: Array, z: Array) -> Array:
        full_y, full_z = (np.zeros((len(self.model.measurements), *a.shape[1:])) for a in (y, z))
        full_y[self.rows], full_z[self.rows] = y, z
        return self.model.residual(full_y, full_z)[self.rows]
