"""Smoothers: the state at one step from measurements up to a later one (fixed point), and all states from all
measurements (RTS).

Both are made of what any recursive linear filter shows of a step: prior xm, P and posterior xp, Pp. So every robust
filter of the package smooths.

    fixed point   xj = xp_j, Pi = Pp_j, Sig = Pp_j F'                                      at k = j
                  J = Sig P^-1;  xj <- xj + J (xp - xm);  Pi <- Pi - J (P - Pp) J';  Sig <- J Pp F'     for k = j+1 ..
                  j+lag
    RTS           J = Pp F' P_{k+1}^-1;  xs = xp + J (xs_{k+1} - xm_{k+1});  Ps = Pp + J (Ps_{k+1} - P_{k+1}) J'

Sig = cov(x_j, x_k) is that of the state augmented by a frozen x_j, eqs (17)-(24) of the FP-MCS paper, whose own
recursion stands in `fpmcs`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge

from rkfbench.errors import SpecError
from rkfbench.filters import recursion
from rkfbench.filters.base import Estimate, Filter, Known, Setting
from rkfbench.filters.recursion import History, Recursive, Step
from rkfbench.linalg import Array, mul, sandwich, solve, sym, transpose
from rkfbench.models import Model
from rkfbench.streams import Streams

At = Annotated[int | None, Ge(1), "the step j whose state is estimated; default: the scenario's point"]
Lag = Annotated[int | None, Ge(0), "measurements after j that are used, at most; default: the scenario's point"]
Start = Annotated[
    Literal["j", "skip", "stale"],
    "j: y_j is used; skip: smoothing begins with y_{j+1}; "
    "stale: as skip, with the prior P_j as the covariance of x_j and x_{j+1}",
]
Inner = Annotated[Any, "the filter, in any form that a scenario may write"]

SEES = frozenset({"cov", "prior_mean", "prior_cov", "post_mean", "post_cov"})  # the last four: the filter's own, at j


@dataclass(frozen=True)
class FixedPoint:
    """Fixed-point smoother around a recursive filter: estimates of x_j from y_1 .. y_{j+t}, t = 0 .. lag."""

    filter: Any
    at: int | None = None
    lag: int | None = None
    start: Start = "j"

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep; `cov` runs over the lag, the others have one step."""
        return SEES

    @property
    def target(self) -> int | None:
        """The step j."""
        return self.at

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear and the filter one that smooths."""
        check_smoothable(self.filter, model)

    def placed(self, setting: Setting) -> FixedPoint:
        """The smoother at the point of an experiment, where its own description does not say which."""
        at, lag = point(self.at, self.lag, setting)
        return replace(self, filter=placed(self.filter, setting), at=at, lag=lag)

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The estimates of x_j: mean (lag + 1, n, M), cov likewise; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        at, lag = ends(self.at, self.lag, len(y))
        with np.errstate(all="ignore"):
            steps = _steps(self.filter, model, y, x0, P0, Q, R, known)
            first = next(step for k, step in enumerate(steps, 1) if k == at)
            history = History({*keep} & {"cov"}, lag + 1)
            x, Pi = (first.x, first.P) if self.start == "j" else (first.prior_x, first.prior_P)
            last, cross = first, first.P  # cov(x_j, x_k) after y_k
            history.add(mean=x, cov=Pi)
            for k, step in zip(range(at + 1, at + lag + 1), steps, strict=False):
                stale = self.start == "stale" and last is first
                Sig = first.prior_P if stale else _to_next(model, cross, last.x, k - 1)
                J = transpose(solve(step.prior_P, transpose(Sig)))
                x = x + mul(J, step.x - step.prior_x)
                Pi = Pi - sandwich(J, step.prior_P - step.P)
                last, cross = step, mul(J, step.P)
                history.add(mean=x, cov=Pi)
        estimate = history.estimate(failed=np.isnan(x).any(0))
        own = {"prior_mean": first.prior_x, "post_mean": first.x, "prior_cov": first.prior_P, "post_cov": first.P}
        return replace(estimate, target=at, extras={name: value[None] for name, value in own.items()})


@dataclass(frozen=True)
class RauchTungStriebel:
    """Fixed-interval smoother (Rauch, Tung, Striebel) around a recursive filter: all x_k from y_1 .. y_T."""

    filter: Any

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return frozenset({"cov"})

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear and the filter one that smooths."""
        check_smoothable(self.filter, model)

    def placed(self, setting: Setting) -> RauchTungStriebel:
        """The smoother with its filter placed in an experiment."""
        return replace(self, filter=placed(self.filter, setting))

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The estimates; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        with np.errstate(all="ignore"):
            steps = list(_steps(self.filter, model, y, x0, P0, Q, R, known))
            x, P = steps[-1].x, steps[-1].P
            backwards = [(x, P)]
            for k in range(len(steps) - 1, 0, -1):
                now, after = steps[k - 1], steps[k]
                J = transpose(solve(after.prior_P, transpose(_to_next(model, now.P, now.x, k))))
                x = now.x + mul(J, x - after.prior_x)
                P = now.P + sandwich(J, sym(P - after.prior_P))
                backwards.append((x, P))
        history = History({*keep} & {"cov"}, len(steps))
        for x, P in reversed(backwards):
            history.add(mean=x, cov=P)
        return history.estimate(failed=np.isnan(steps[-1].x).any(0))


def fixed_point(filter: Inner, at: At = None, lag: Lag = None, start: Start = "j") -> Any:
    """Fixed-point smoother: the state at step j from measurements up to j + lag, by any linear recursive filter or by
    particles.

    J = Sig P^-1; xj + J (x+ - x-), Pi - J (P- - P+) J', Sig <- J P+ F', on the state augmented by a frozen x_j.
    """
    inner = inner_filter(filter)
    smoother = getattr(inner, "fixed_point", None)
    return smoother(at, lag, start) if smoother else FixedPoint(inner, at, lag, start)


def rts(filter: Inner = "kf") -> RauchTungStriebel:
    """Rauch-Tung-Striebel smoother: all states from all measurements, by any linear recursive filter."""
    return RauchTungStriebel(inner_filter(filter))


def placed(filt: Filter, setting: Setting) -> Filter:
    """The filter in an experiment: told there what its description leaves out, where it has a method to be told."""
    place = getattr(filt, "placed", None)
    told: Filter = filt if place is None else place(setting)
    return told


def point(at: int | None, lag: int | None, setting: Setting) -> tuple[int, int]:
    """Step j and lag, from the filter's own description or the scenario's point; SpecError where they leave the run."""
    j, t = (
        own if own is not None else default
        for own, default in zip((at, lag), setting.point or (None, None), strict=True)
    )
    if j is None or t is None:
        raise SpecError(f"needs `{'at' if j is None else 'lag'}`: the scenario has no point either")
    if not 1 <= j <= setting.steps:
        raise SpecError(f"step {j} is not within 1..{setting.steps}", ["at"] if at is not None else ())
    if j + t > setting.steps:
        raise SpecError(f"{j} + {t} lies beyond the last step, {setting.steps}", ["lag"] if lag is not None else ())
    return j, t


def ends(at: int | None, lag: int | None, T: int) -> tuple[int, int]:
    """Step j and lag of a smoother that runs on T measurements."""
    if at is None or lag is None:
        raise SpecError("a smoother needs `at` and `lag`")
    if not 1 <= at <= at + lag <= T:
        raise SpecError(f"steps {at}..{at + lag} are not within 1..{T}")
    return at, lag


def check_smoothable(filt: Any, model: Model) -> None:
    """SpecError unless the model is linear and the filter shows its steps."""
    check = getattr(filt, "check", None)
    if check is not None:
        check(model)
    if not model.linear:
        raise SpecError("a smoother needs a linear model")
    if not (hasattr(filt, "steps") or (hasattr(filt, "predict") and hasattr(filt, "correct"))):
        raise SpecError("only recursive filters, with a prediction and an update a step, can be smoothed", ["filter"])


def inner_filter(spec: Any) -> Filter:
    from rkfbench.filters import build  # it builds this wrapper in turn

    try:
        return build(spec)
    except SpecError as error:
        raise error.under("filter") from None


def _steps(
    filt: Any, model: Model, y: Array, x0: Array, P0: Array, Q: Array, R: Array, known: Known | None
) -> Iterator[Step]:
    """The steps of the filter: its own, or those of the common loop over time."""
    if hasattr(filt, "steps"):
        own: Iterator[Step] = filt.steps(model, y, x0, P0, Q=Q, R=R, known=known)
        return own
    recursive: Recursive = filt
    return recursion.steps(recursive, model, *recursion.prepare(model, y, x0, P0, Q, R))


def _to_next(model: Model, A: Array, x: Array, k: int) -> Array:
    """A F' with the transition from k to k + 1."""
    return transpose(mul(model.F(x, k + 1), transpose(A)))
