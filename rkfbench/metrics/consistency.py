"""Whether a covariance tells the error, as a whole and along the line of sight; and the number by which a scenario
judges a run.

Radial and tangential are meant in the plane of the first two states named. Errors are taken at the truth: r^ - r along,
and r times the error of the bearing across. Standard deviations of P are taken at the estimate, along the unit vector
to it and across.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.linalg import Array, eigvalsh, positive_definite
from rkfbench.metrics.base import Better, Each, Trial, over_time
from rkfbench.metrics.errors import SquaredError
from rkfbench.models import wrap

Parts = dict[str, Any]
Direction = Literal["radial", "tangential"]
Principal = Literal["least", "largest"]


@dataclass(frozen=True)
class MeanOverStates(SquaredError):
    """Mean of the squared errors of the states."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return super().__call__(trial, states) / len(states)


@dataclass(frozen=True)
class StatedSquare(Each):
    """Trace of P over the states: the squared error that the filter states."""

    keep: ClassVar[frozenset[str]] = frozenset({"cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        P = trial.estimate.cov
        if P is None:
            raise SpecError("the covariance of the estimate is needed")
        return np.asarray(sum(P[:, i, i] for i in states))


@dataclass(frozen=True)
class PolarError(Each):
    """Squared error along or across the line of sight."""

    along: Direction = "radial"
    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        i, j = states[:2]
        (ex, ey), (x, y) = (trial.estimate.mean[:, [i, j]].swapaxes(0, 1), trial.truth()[:, [i, j]].swapaxes(0, 1))
        r = np.hypot(x, y)
        if self.along == "radial":
            return np.asarray((np.hypot(ex, ey) - r) ** 2)
        return np.asarray((r * wrap(np.arctan2(ey, ex) - np.arctan2(y, x))) ** 2)


@dataclass(frozen=True)
class PolarVariance(Each):
    """u' P u of the unit vector u to the estimate (radial), or across it."""

    along: Direction = "radial"
    keep: ClassVar[frozenset[str]] = frozenset({"cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        i, j = states[:2]
        x, y, P = trial.estimate.mean[:, i], trial.estimate.mean[:, j], trial.estimate.cov
        assert P is not None
        ux, uy = (x, y) if self.along == "radial" else (-y, x)
        return np.asarray((ux * ux * P[:, i, i] + 2 * ux * uy * P[:, i, j] + uy * uy * P[:, j, j]) / (x * x + y * y))


@dataclass(frozen=True)
class PrincipalVariance(Each):
    """The least or the largest eigenvalue of P over the states."""

    which: Principal = "least"
    keep: ClassVar[frozenset[str]] = frozenset({"cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        P = trial.estimate.cov
        assert P is not None
        place = 0 if self.which == "least" else -1
        return over_time(lambda A: eigvalsh(A)[place], P[:, states][:, :, states])


@dataclass(frozen=True)
class Excess(Each):
    """Stated minus actual square: trace of P - e e' over the states named, or its part across or along the line of
    sight to the truth.

    Where its mean over the runs is below 0, the mean of P minus the mean square error matrix is not positive definite,
    as its smallest eigenvalue is no larger than this mean (per state).
    """

    along: Literal["all", "radial", "tangential"] = "all"
    keep: ClassVar[frozenset[str]] = frozenset({"cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        P = trial.estimate.cov
        assert P is not None
        if self.along == "all":
            return np.asarray(StatedSquare()(trial, states) - SquaredError()(trial, states))
        i, j = states[:2]
        error, (x, y) = trial.estimate.mean - trial.truth(), trial.truth()[:, [i, j]].swapaxes(0, 1)
        ux, uy = (x, y) if self.along == "radial" else (-y, x)
        stated = ux * ux * P[:, i, i] + 2 * ux * uy * P[:, i, j] + uy * uy * P[:, j, j]
        return np.asarray((stated - (ux * error[:, i] + uy * error[:, j]) ** 2) / (x * x + y * y))


@dataclass(frozen=True)
class ExcessEntry(Each):
    """One entry P_ij - e_i e_j of the stated minus the actual square, of two states or of one named twice.

    The mean over the runs is the entry of mean P minus the mean square error matrix.
    """

    keep: ClassVar[frozenset[str]] = frozenset({"cov"})
    of_two: ClassVar[bool] = True

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        P = trial.estimate.cov
        assert P is not None
        i, j = states
        error = trial.estimate.mean - trial.truth()
        return np.asarray(P[:, i, j] - error[:, i] * error[:, j])


@dataclass(frozen=True)
class Indefinite(Each):
    """1 after an update whose P is not positive definite, else 0."""

    keep: ClassVar[frozenset[str]] = frozenset({"cov"})
    better: ClassVar[Better | None] = "small"

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        assert trial.estimate.cov is not None
        return over_time(lambda P: ~positive_definite(P), trial.estimate.cov).astype(float)


@dataclass(frozen=True)
class Crossing(Each):
    """1 where the true bearing of the first two states named crossed the cut at +-pi since the last step, else 0."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        x, y = trial.truth()[:, states[0]], trial.truth()[:, states[1]]
        jump = np.abs(np.diff(np.arctan2(y, x), axis=0, prepend=np.arctan2(y, x)[:1]))
        return (jump > np.pi).astype(float)


@dataclass(frozen=True)
class Score(Each):
    """The metric that the scenario's `score` names; one value a run, at the last step."""

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.array([T])

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        from rkfbench.metrics import get

        return get(trial.experiment.score)(trial)[None]


def axis_rmse() -> Parts:
    """Root of the mean squared error over the steps and the states named: `rmse` over the root of their number."""
    return {"quantity": MeanOverStates(), "reduce": "root"}


def stated_rmse() -> Parts:
    """The `rmse` that the filter states for itself: root of the mean trace of P over the states named."""
    return {"quantity": StatedSquare(), "reduce": "root"}


def radial_rmse() -> Parts:
    """Root of the mean squared error along the line of sight: of r^ - r."""
    return {"quantity": PolarError("radial"), "reduce": "root"}


def tangential_rmse() -> Parts:
    """Root of the mean squared error across the line of sight: of r times the error of the bearing."""
    return {"quantity": PolarError("tangential"), "reduce": "root"}


def radial_sd() -> Parts:
    """Standard deviation of P along the line of sight to the estimate."""
    return {"quantity": PolarVariance("radial"), "reduce": "root"}


def principal_sd(which: Annotated[Principal, "the shortest or the longest axis"] = "least") -> Parts:
    """Standard deviation of P along one of its principal axes, wherever that points."""
    return {"quantity": PrincipalVariance(which), "reduce": "root"}


def tangential_sd() -> Parts:
    """Standard deviation of P across the line of sight to the estimate."""
    return {"quantity": PolarVariance("tangential"), "reduce": "root"}


def excess(
    along: Annotated[Literal["all", "radial", "tangential"], "the trace, or one direction of the plane"] = "all",
) -> Parts:
    """Stated minus actual squared error, tr(P - e e'); a mean below 0 says that the covariance is underestimated."""
    return {"quantity": Excess(along)}


def excess_entry() -> Parts:
    """Entry of the stated minus the actual square, P - e e', for two states, or one named twice: `[x,y]`, `[x,x]`."""
    return {"quantity": ExcessEntry()}


def indefinite() -> Parts:
    """Share of the updates that leave a P which is not positive definite; sigma points then come from its positive
    part.
    """
    return {"quantity": Indefinite()}


def crossed() -> Parts:
    """1 for a run whose true bearing crosses the cut at +-pi, else 0."""
    return {"quantity": Crossing(), "reduce": "max"}


def score() -> Parts:
    """The error of a run as the scenario's `score` says; readings may mean different errors by it."""
    return {"quantity": Score(), "reduce": "last"}
