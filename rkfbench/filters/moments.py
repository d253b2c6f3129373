"""Moments: how a mean and a covariance pass through f and h.

Each rule answers two questions: `propagate` gives the mean and covariance of f(x), without Q; `measure` gives the mean
z of h(x), its covariance Szz without R, and Pxz = cov(x, h(x)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple, Protocol

from rkfbench.errors import SpecError
from rkfbench.linalg import Array, sandwich, through
from rkfbench.models import Model


class Measured(NamedTuple):
    """Moments of h(x): z (m, M), Szz (m, m, M), Pxz (n, m, M), and hx = h at the mean (m, M)."""

    z: Array
    Szz: Array
    Pxz: Array
    hx: Array


class Moments(Protocol):
    """A rule for the moments of a function of a Gaussian."""

    def check(self, model: Model) -> None:
        """SpecError if the rule cannot serve the model."""
        ...

    def propagate(self, model: Model, x: Array, P: Array, k: int) -> tuple[Array, ...]:
        """Mean (n, M) and covariance (n, n, M) of f(x) for x of mean x and covariance P; behind them points to hand
        over to `at`, if any.
        """
        ...

    def at(self, x: Array, *points: Array) -> Moments:
        """The rule for one update of the predicted mean x, given what `propagate` handed over."""
        ...

    def measure(self, model: Model, x: Array, P: Array, k: int) -> Measured:
        """Moments of h(x)."""
        ...

    def slope(self, model: Model, x: Array, P: Array, k: int) -> Array:
        """H (m, n) or (m, n, M) of the linear function that stands for h: Pxz = P H'."""
        ...


LineariseAt = Annotated[
    Literal["posterior", "predicted"], "where F is taken: at the last posterior mean, or at the predicted one"
]


class Jacobians:
    """The moments of h by its Jacobian: z = h(x), Szz = H P H', Pxz = P H'."""

    def check(self, model: Model) -> None:
        """Every model of the catalogue has Jacobians; a model of another kind must bring F and H."""
        if not (hasattr(model, "F") and hasattr(model, "H")):
            raise SpecError("taylor moments need a model with the Jacobians F and H")

    def at(self, x: Array, *points: Array) -> Moments:
        return self

    def propagate(self, model: Model, x: Array, P: Array, k: int) -> tuple[Array, ...]:
        return model.f(x, k), sandwich(model.F(x, k), P)

    def measure(self, model: Model, x: Array, P: Array, k: int) -> Measured:
        z = model.h(x, k)
        return Measured(z, *through(model.H(x, k), P), z)

    def slope(self, model: Model, x: Array, P: Array, k: int) -> Array:
        return model.H(x, k)


@dataclass(frozen=True)
class Taylor(Jacobians):
    """First-order Taylor moments: f(x) and F P F'; z = h(x), Szz = H P H', Pxz = P H' with the Jacobians at the mean.

    `linearise_at: predicted` takes F at f(x), where eq. (39) of the PEKF paper prints it, though (39) precedes the
    prediction that it would need.
    """

    linearise_at: LineariseAt = "posterior"

    def propagate(self, model: Model, x: Array, P: Array, k: int) -> tuple[Array, ...]:
        reached = model.f(x, k)
        return reached, sandwich(model.F(x if self.linearise_at == "posterior" else reached, k), P)


@dataclass(frozen=True)
class Linear(Jacobians):
    """Exact moments of a linear model: F x, F P F'; H x, H P H', P H'."""

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear."""
        if not model.linear:
            raise SpecError(
                "linear moments need a linear model (taylor, unscented and cubature moments serve any model)"
            )
