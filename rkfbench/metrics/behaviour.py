"""How an estimate behaves over time: its jumps, how it comes back after a manoeuvre, and whether its covariance tells
its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.linalg import Array, dot, solve
from rkfbench.metrics.base import Better, Each, Trial, over_time
from rkfbench.metrics.consistency import StatedSquare


@dataclass(frozen=True)
class State(Each):
    """The estimate of one state, or the sum over several."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.asarray(trial.estimate.mean[:, states].sum(1))


@dataclass(frozen=True)
class Error(Each):
    """Estimate minus truth of one state, or the sum over several."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.asarray((trial.estimate.mean[:, states] - trial.truth()[:, states]).sum(1))


@dataclass(frozen=True)
class Fluctuation(Each):
    """|e_k - e_{k-1}|^2 of the errors e of the states, k = 2..T."""

    better: ClassVar[Better | None] = "small"

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.arange(2, T + 1)

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        error = trial.estimate.mean[:, states] - trial.truth()[:, states]
        return np.asarray((np.diff(error, axis=0) ** 2).sum(1))


@dataclass(frozen=True)
class Settling(Each):
    """Steps from the end of the scripted manoeuvre until the absolute error of every state stays below a limit;
    infinite if it does not.

    One number a run, at the last step; without a script the steps are counted from the first one.
    """

    limit: float = 5.0
    better: ClassVar[Better | None] = "small"

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.array([T])

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        size = np.abs(trial.estimate.mean[:, states] - trial.truth()[:, states]).max(1)
        end = getattr(trial.experiment.script, "manoeuvre", (0, 0))[1]
        above = ~(size <= self.limit)
        last = np.where(above.any(0), len(above) - np.argmax(above[::-1], axis=0), 0)
        return np.where(last == len(above), np.inf, np.maximum(last + 1 - end, 0).astype(float))[None]


@dataclass(frozen=True)
class Nees(Each):
    """Normalised error e' P^-1 e of the states: chi-square with as many degrees of freedom, if the filter is
    consistent.
    """

    keep: ClassVar[frozenset[str]] = frozenset({"cov"})

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        if trial.estimate.cov is None:
            raise SpecError("nees needs the covariance of the estimate")
        error = trial.estimate.mean[:, states] - trial.truth()[:, states]
        cov = trial.estimate.cov[:, states][:, :, states]
        return over_time(lambda e, P: dot(e, solve(P, e)), error, cov)


@dataclass(frozen=True)
class StandardDeviation(StatedSquare):
    """What the filter says of its own error: the root of the summed variances of the states."""

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        return np.sqrt(super().__call__(trial, states))


@dataclass(frozen=True)
class SquaredDifference(Each):
    """|x - x~|^2 over the states: how far another filter's estimate is."""

    to: str = ""

    @property
    def partners(self) -> dict[str, frozenset[str]]:  # type: ignore[override]
        return {self.to: frozenset()}

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        apart = trial.estimate.mean[:, states] - trial.others[self.to].mean[:, states]
        return np.asarray((apart * apart).sum(1))


@dataclass(frozen=True)
class Distance(Each):
    """|x - x~|/sqrt(P_ii) of one state: distance from another filter's estimate, in own standard deviations."""

    keep: ClassVar[frozenset[str]] = frozenset({"cov"})
    to: str = ""

    @property
    def partners(self) -> dict[str, frozenset[str]]:  # type: ignore[override]
        return {self.to: frozenset()}

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        if trial.estimate.cov is None:
            raise SpecError("distance needs the covariance of the estimate")
        apart = np.abs(trial.estimate.mean[:, states] - trial.others[self.to].mean[:, states])
        variance = np.stack([trial.estimate.cov[:, i, i] for i in states], axis=1)
        return np.asarray((apart / np.sqrt(variance)).max(1))
