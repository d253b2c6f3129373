"""Update schemes: how often and how far a measurement update is taken.

    once         one update                                         S = H P H' + R
    progressive  1/dl sub-steps, gain times dl, plain R in S        (37)-(38) of the PEKF paper, as printed
    tempered     1/dl sub-steps with R/dl                           each takes the likelihood to the power dl
    inflated     one update, S = (1 + c) H P H' + R                 the inflation of `progressive` without sub-steps
    iterated     Gauss-Newton on the posterior mode                 re-linearisation without either

In every sub-step the moments, the residual and the robust weight are renewed at the newest mean. H P H' and P H' stand
for the Szz and Pxz of the moments, after the weight's D. With dl = 1 `progressive`, `tempered` and
`inflated` are `once`, to the last bit. What
a scheme shows of an update (nu, S, weights) is that of its first look, at the prior.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from annotated_types import Ge, Interval

from rkfbench.errors import SpecError
from rkfbench.filters.base import Posterior
from rkfbench.filters.moments import Moments
from rkfbench.filters.weights import Weight
from rkfbench.linalg import Array, condition, mul
from rkfbench.models import Model

Step = Annotated[float, Interval(gt=0, le=1), "pseudo-time of a sub-step; 1/dl is a whole number"]


class Scheme(Protocol):
    """A way to take the update with y (m, M) from the prior (x, P)."""

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior: ...


class Look(NamedTuple):
    """What an update needs at a mean: Szz (m, m, M), cov(x, y) = C (n, m, M), R, the innovation and D (diagonal, None:
    identity) after the weight; what is seen.
    """

    Szz: Array
    C: Array
    R: Array
    nu: Array
    D: Array | None
    seen: Mapping[str, Array]

    def update(self, x: Array, P: Array, S: Array, step: float = 1.0) -> tuple[Array, Array]:
        """x + step K nu and P - step K S K', with K = C S^-1."""
        if step == 1:
            return condition(x, P, self.C, S, self.nu)
        root = np.sqrt(step)
        return condition(x, P, root * self.C, S, root * self.nu)


def look(moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array) -> Look:
    """The moments of h at (x, P) and the residual of y as the weight leaves them."""
    z, Szz, Pxz, hx = moments.measure(model, x, P, k)
    nu = model.residual(y, z)
    R, weighted, D, seen = weight(nu, nu if hx is z else model.residual(y, hx), R, Szz)
    if D is not None:
        Szz, Pxz = D[:, None] * Szz * D, Pxz * D
    return Look(Szz, Pxz, R, weighted, D, {"nu": nu, "S": Szz + R, **seen})


MOST_SUBSTEPS = 10_000


def whole_steps(dl: float) -> int:
    """1/dl. SpecError if that is not a whole number, or too large for anybody to wait for."""
    if dl * MOST_SUBSTEPS < 1:
        raise SpecError(f"1/dl must not be more than {MOST_SUBSTEPS} sub-steps", ["dl"])
    steps = round(1 / dl)
    if abs(steps * dl - 1) > 1e-9:
        raise SpecError(f"1/dl must be a whole number of sub-steps, 1/{dl:g} = {1 / dl:.6g} is not", ["dl"])
    return steps


@dataclass(frozen=True)
class Once:
    """The Kalman update: S = D Szz D + R', K = Pxz D S^-1, x + K nu', P - K S K'."""

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        at = look(moments, weight, model, x, P, y, k, R)
        return Posterior(*at.update(x, P, at.seen["S"]), at.seen)


@dataclass(frozen=True)
class Progressive:
    """1/dl sub-steps x + dl K nu, P - dl K H P with K = P H' S^-1 and plain R in S = H P H' + R, eqs (37)-(38) as
    printed.

    One sub-step is exactly one Kalman update with R/dl + (1/dl - 1) H P H' in the place of R. So for dl < 1 this is not
    Bayes' rule, not even for linear h, where it leaves at least the fraction (1 - dl)^(1/dl) of the prior variance,
    however precise the measurement is.
    """

    dl: Step = 0.1

    def __post_init__(self) -> None:
        whole_steps(self.dl)

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        seen: Mapping[str, Array] = {}
        for _ in range(steps := whole_steps(self.dl)):
            at = look(moments, weight, model, x, P, y, k, R)
            x, P = at.update(x, P, at.seen["S"], 1 / steps)
            seen = seen or at.seen
        return Posterior(x, P, seen)


@dataclass(frozen=True)
class Tempered:
    """1/dl Kalman updates with R/dl: a consistent discretisation of the flow (35), exact for linear h at every dl."""

    dl: Step = 0.1

    def __post_init__(self) -> None:
        whole_steps(self.dl)

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        steps = whole_steps(self.dl)
        return portions([1 / steps] * steps, moments, weight, model, x, P, y, k, R)


def portions(
    lengths: list[float], moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
) -> Posterior:
    """Kalman updates with R/l for the lengths l of pseudo-time, one after the other."""
    seen: Mapping[str, Array] = {}
    for length in lengths:
        at = look(moments, weight, model, x, P, y, k, R)
        x, P = at.update(x, P, at.Szz + at.R / length)
        seen = seen or at.seen
    return Posterior(x, P, seen)


@dataclass(frozen=True)
class Inflated:
    """One Kalman update with S = (1 + c) H P H' + R, c = p/(1 - p), p = (1 - dl)^(1/dl).

    c is the total inflation of `progressive` for a very precise linear measurement: 0 at dl = 1, 0.535 at 0.1, 1/(e -
    1) as dl -> 0.
    """

    dl: Step = 0.1

    def __post_init__(self) -> None:
        whole_steps(self.dl)

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        at = look(moments, weight, model, x, P, y, k, R)
        left = (1 - self.dl) ** whole_steps(self.dl)
        return Posterior(*at.update(x, P, (1 + left / (1 - left)) * at.Szz + at.R), at.seen)


@dataclass(frozen=True)
class Iterated:
    """Plain Gauss-Newton, z <- x + K (y - h(z) - H (x - z)) with H at z and K = P H' (H P H' + R)^-1; then P - K H P
    with the last of them.

    Sigma-point moments are taken about z with the prior covariance, and H is the slope that they imply, H = Pxz' P^-1.
    """

    iterations: Annotated[int, Ge(1), "number of re-linearisations"] = 10

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        seen: Mapping[str, Array] = {}
        z, after = x, P
        for _ in range(self.iterations):
            at = look(moments, weight, model, z, P, y, k, R)
            if z is not x:
                back = mul(moments.slope(model, z, P, k), x - z)
                at = at._replace(nu=at.nu - (back if at.D is None else at.D * back))
            z, after = at.update(x, P, at.seen["S"])
            seen = seen or at.seen
        return Posterior(z, after, seen)
