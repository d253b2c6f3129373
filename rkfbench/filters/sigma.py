"""Sigma-point moments: unscented, cubature and divided-difference rules, all of them on one star of 2n + 1 points.

The star of N(x, P) with P = L L' is x and x +- h l_i, l_i the columns of L. A function g sees it as an odd part e_i and
an even part c_i about g(x),

    e_i = (g(x + h l_i) - g(x - h l_i))/2,     c_i = (g(x + h l_i) + g(x - h l_i))/2 - g(x),

    mean g(x) + cbar,  cbar = sum_i c_i / h^2,     cov(g, g~) = sum_i (e_i e~_i' + a c_i c~_i') / h^2 + b cbar cbar~'.

    unscented            h^2 = alpha^2 (n + kappa),  a = 1,            b = beta - alpha^2
    cubature             h^2 = n,                    a = 1,            b = -1
    divided difference   h^2 free (3),               a = 1 - 1/h^2,    b = 0

which are the usual weighted sums, written so that nothing cancels: the state's own star has e = h L and c = 0, and a
linear g has c = 0. Angles are offsets from h(x), wrapped before they are averaged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np
from annotated_types import Gt

from rkfbench.errors import SpecError
from rkfbench.filters.moments import Measured, Moments
from rkfbench.linalg import Array, cholesky, eigh, gram, mul, outer, sandwich, solve, transpose
from rkfbench.models import Model

Redraw = Annotated[
    bool, "draw new points from the predicted mean and covariance at the update; false: reuse the propagated ones"
]


class Star(NamedTuple):
    """A function on the star: cbar (d, M), and side by side twice its odd parts and sqrt(a) times twice its even parts,
    (d, 2n, M).
    """

    offset: Array
    parts: Array

    @property
    def odd(self) -> Array:
        """Twice the odd parts, (d, n, M)."""
        return self.parts[:, : self.parts.shape[1] // 2]


class Rule(NamedTuple):
    """The numbers h^2, a and b of a rule."""

    h2: float
    a: float
    b: float


@dataclass(frozen=True)
class SigmaPoints:
    """What the sigma-point rules share; `rule(n)` makes the difference."""

    redraw: Redraw = True

    def rule(self, n: int) -> Rule:
        """The numbers of the rule in n dimensions."""
        return Rule(float(n), 1.0, -1.0)

    def check(self, model: Model) -> None:
        """SpecError if the rule has no points in the model's dimension."""
        self.rule(len(model.states))

    def at(self, x: Array, *points: Array) -> Moments:
        """The rule itself, or with the propagated points."""
        return Reusing(self, x, *points) if points else self

    def propagate(self, model: Model, x: Array, P: Array, k: int) -> tuple[Array, ...]:
        """Mean (n, M) and covariance (n, n, M) of f(x); without `redraw` also the propagated points (n, 2n + 1, M).

        Of an affine f all rules make f(x) and F P F' (e = h F L, c = 0), which takes no points.
        """
        if self.redraw and getattr(model, "affine", False):
            return model.f(x, k), sandwich(model.F(x, k), P)
        rule = self.rule(len(x))
        points = model.f(_points(x, square_root(P), rule), k)
        reached = _star(points[:, 1:] - points[:, :1], rule)
        moments = points[:, 0] + reached.offset, _covariance(reached, reached, rule)
        return moments if self.redraw else (*moments, points)

    def measure(self, model: Model, x: Array, P: Array, k: int) -> Measured:
        """Moments of h(x) on points drawn at x and P."""
        rule = self.rule(len(x))
        L = square_root(P)
        values = model.h(_points(x, L, rule), k)
        hx = values[:, 0]
        seen = _star(model.residual(values[:, 1:], values[:, :1]), rule)
        Pxz = mul(L, transpose(seen.odd))
        Pxz /= 2 * np.sqrt(rule.h2)
        return Measured(hx + seen.offset, _covariance(seen, seen, rule), Pxz, hx)

    def measure_at(self, model: Model, x: Array, points: Array, k: int) -> Measured:
        """Moments of h(x) on points (n, 2n + 1, M) that another function has moved; x is their mean."""
        rule = self.rule(len(x))
        hx, values = model.h(x, k), model.h(points, k)
        state = _star(points[:, 1:] - points[:, :1], rule)
        seen = _star(model.residual(values[:, 1:], values[:, :1]), rule)
        z = hx + model.residual(values[:, 0], hx) + seen.offset
        return Measured(z, _covariance(seen, seen, rule), _covariance(state, seen, rule), hx)

    def slope(self, model: Model, x: Array, P: Array, k: int) -> Array:
        """H = Pxz' P^-1, the statistical linearisation."""
        return transpose(solve(P, self.measure(model, x, P, k).Pxz))


@dataclass(frozen=True)
class Unscented(SigmaPoints):
    """Unscented moments: weights W0m = 1 - n/h^2, W0c = W0m + 1 - alpha^2 + beta and 1/(2 h^2), h^2 = alpha^2 (n +
    kappa).
    """

    redraw: Redraw = True
    alpha: Annotated[float, Gt(0), "spread of the points"] = 1.0
    beta: Annotated[float, "weight of the centre in covariances: 2 for a Gaussian and small alpha"] = 0.0
    kappa: Annotated[float | Literal["3-n"], "second spread, n + kappa > 0"] = "3-n"

    def rule(self, n: int) -> Rule:
        kappa = 3 - n if self.kappa == "3-n" else float(self.kappa)
        if not n + kappa > 0:
            raise SpecError(f"n + kappa must be positive: the model has n = {n} states, kappa is {kappa:g}")
        square = self.alpha * self.alpha
        if not 0 < square * (n + kappa) < np.inf:
            raise SpecError(f"alpha^2 (n + kappa) must be a positive number, it is {square * (n + kappa):g}", ["alpha"])
        return Rule(square * (n + kappa), 1.0, self.beta - square)


@dataclass(frozen=True)
class Cubature(SigmaPoints):
    """Third-degree spherical-radial cubature: 2n points x +- sqrt(n) l_i with equal weights; the centre has none."""


@dataclass(frozen=True)
class DividedDifference(SigmaPoints):
    """Second-order divided differences (Norgaard, Poulsen and Ravn 2000) with interval length h."""

    h2: Annotated[float, Gt(1), "square h^2 of the interval length; 3 fits a Gaussian's fourth moment"] = 3.0

    def rule(self, n: int) -> Rule:
        return Rule(self.h2, 1.0 - 1.0 / self.h2, 0.0)


@dataclass(frozen=True)
class Reusing:
    """A sigma-point rule for one update that already has points: they serve where the mean is x; elsewhere new ones are
    drawn.
    """

    rule: SigmaPoints
    x: Array
    points: Array

    def check(self, model: Model) -> None:
        self.rule.check(model)

    def at(self, x: Array, *points: Array) -> Moments:
        return self.rule.at(x, *points)

    def propagate(self, model: Model, x: Array, P: Array, k: int) -> tuple[Array, ...]:
        return self.rule.propagate(model, x, P, k)

    def measure(self, model: Model, x: Array, P: Array, k: int) -> Measured:
        if x is self.x:
            return self.rule.measure_at(model, x, self.points, k)
        return self.rule.measure(model, x, P, k)

    def slope(self, model: Model, x: Array, P: Array, k: int) -> Array:
        return self.rule.slope(model, x, P, k)


def square_root(P: Array) -> Array:
    """Some L with L L' = P (n, n, M): the lower Cholesky factor, and where P is not positive definite a root of its
    positive part.

    Elimination without pivots needs no scaling: its error in P_ij is of the order of the rounding of sqrt(P_ii P_jj),
    however different the variances are. The positive part is that of the correlations, D^-1 P D^-1 with D^2 = |diag P|,
    so it does not depend on units either.
    """
    L = cholesky(P)
    if np.isnan(L[-1, -1]).any() and (bad := np.isnan(L[-1, -1]) & np.isfinite(P).all((0, 1))).any():
        D = np.sqrt(np.abs(np.einsum("iim->im", P[..., bad])))
        D = np.where(D > 0, D, 1.0)
        w, V = eigh(P[..., bad] / outer(D, D))
        L[..., bad] = D[:, None] * V * np.sqrt(np.maximum(w, 0.0))
    return L


def _points(x: Array, L: Array, rule: Rule) -> Array:
    """x, x + h l_i and x - h l_i side by side, (n, 2n + 1, M)."""
    n = len(x)
    points = np.empty((n, 2 * n + 1, x.shape[-1]))
    centre, plus, minus = points[:, :1], points[:, 1 : n + 1], points[:, n + 1 :]
    centre[:, 0] = x
    np.multiply(L, np.sqrt(rule.h2), out=plus)
    np.subtract(centre, plus, out=minus)
    plus += centre
    return points


def _star(moves: Array, rule: Rule) -> Star:
    """The star of a function from g(x + h l_i) - g(x) and g(x - h l_i) - g(x), side by side (d, 2n, M)."""
    n = moves.shape[1] // 2
    parts = np.empty_like(moves)
    odd, even = parts[:, :n], parts[:, n:]
    np.subtract(moves[:, :n], moves[:, n:], out=odd)
    np.add(moves[:, :n], moves[:, n:], out=even)
    offset = even.sum(1)
    offset /= 2 * rule.h2
    if rule.a != 1:
        even *= np.sqrt(rule.a)
    return Star(offset, parts)


def _covariance(one: Star, other: Star, rule: Rule) -> Array:
    """Covariance of two functions on the same star."""
    C = gram(one.parts) if one is other else mul(one.parts, transpose(other.parts))
    C /= 4 * rule.h2
    if rule.b:
        C += outer(rule.b * one.offset, other.offset)
    return C
