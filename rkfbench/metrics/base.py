"""What a metric is: a quantity at each step of each run, reduced over the steps to one number a run, or left as a
curve.

A metric is written as `name(parameter=value)[states]@steps`: `rmse`, `rmse[px]`, `mse[px]@900` (one step),
`rmse[S]@500..560` (a window), `err_norm@k` (the curve over k). Where a scenario has a `point`, a step j with a lag:
`mse@j` (for a smoother of x_j the estimate with
all its measurements), `mse@j+5` (from measurements up to j + 5, smoothers only), `mse@lag` (the curve over the lag,
smoothers only).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rkfbench.filters.base import Estimate
from rkfbench.linalg import Array

if TYPE_CHECKING:
    from rkfbench.experiment import Experiment, World
    from rkfbench.parts import Told

# What a metric may need to know beyond measurements and estimates; of recorded data it is not always known.
TRUTH = frozenset({"truth"})
RECORD = frozenset({"record"})

TOGETHER = 8192  # columns: their matrices stay in the cache

Better = Literal["small", "large"]
Reduce = Literal["mean", "max", "root", "median", "last", "mean_where", "root_where", "max_where"]


def mean_where(q: Array, axis: int = 0) -> Array:
    """The mean over the steps (or along another axis) that are not NaN; NaN where there is none."""
    there = ~np.isnan(q)
    return np.asarray(np.where(there, q, 0.0).sum(axis) / there.sum(axis))


_REDUCE: dict[str, Callable[[Array], Array]] = {
    "mean": lambda q: q.mean(0),
    "max": lambda q: q.max(0),
    "root": lambda q: np.sqrt(q.mean(0)),
    "median": lambda q: np.median(q, axis=0),
    "last": lambda q: q[-1],
    "mean_where": mean_where,
    "root_where": lambda q: np.sqrt(mean_where(q)),
    "max_where": np.fmax.reduce,
}


@dataclass(frozen=True)
class Trial:
    """One filter on one block of runs: what a metric may look at. `others` are the estimates of the metric's partners,
    by label; `told` is what this filter alone is told, None if that is what all are.
    """

    experiment: Experiment
    world: World
    filter: Any
    estimate: Estimate
    others: Mapping[str, Estimate] = field(default_factory=dict)
    told: Told | None = None
    _seen: dict[Any, Array] = field(default_factory=dict, repr=False)

    def quantity(self, quantity: Quantity, states: tuple[int, ...]) -> Array:
        """The quantity at all its steps, computed once for all metrics that reduce it."""
        if (quantity, states) not in self._seen:
            self._seen[quantity, states] = quantity(self, states)
        return self._seen[quantity, states]

    @property
    def assumed(self) -> Told:
        """What the filter is told: initial mean and covariance, Q and R."""
        return self.told or self.experiment.told

    def truth(self) -> Array:
        """The true states that the means estimate: (T, n, M), or (1, n, M) for a smoother of one point."""
        j = self.estimate.target
        return self.world.x if j is None else self.world.x[j - 1 : j]


class Quantity(Protocol):
    """A quantity at each step of each run."""

    @property
    def keep(self) -> frozenset[str]:
        """Histories of the filter that it needs; a filter that does not have them has no such metric."""
        ...

    @property
    def partners(self) -> Mapping[str, frozenset[str]]:
        """Labels of filters whose estimates it also looks at, each with the histories that it needs of them."""
        ...

    def steps(self, T: int) -> NDArray[np.intp]:
        """The steps k at which it is computed."""
        ...

    def __call__(self, trial: Trial, states: Sequence[int]) -> Array:
        """The quantity (len(steps), M); `states` are the indices of the states it is about."""
        ...


@dataclass(frozen=True)
class Each:
    """The base of quantities that exist at every step and look at no other filter.

    Those that are `of_run` choose steps of each run by themselves, or have one number for all: no curve, no `@500`.
    `better` says which of two filters such a number speaks for; None where it does not, as for `nees`, which has a
    value that it should have, or a covariance, which is only what the filter claims.
    """

    keep: ClassVar[frozenset[str]] = frozenset()
    partners: ClassVar[Mapping[str, frozenset[str]]] = MappingProxyType({})
    of_run: ClassVar[bool] = False
    better: ClassVar[Better | None] = None

    def steps(self, T: int) -> NDArray[np.intp]:
        return np.arange(1, T + 1)


@dataclass(frozen=True)
class Metric:
    """A quantity with what is asked of it. Runs are combined by the mean, with `root` by its root (that of squares)."""

    name: str
    quantity: Quantity
    reduce: Reduce = "mean"
    states: tuple[str, ...] = ()  # () for all
    at: tuple[int, int] | None = None  # first and last step, both included
    curve: bool = False
    root: bool = False
    tracking: bool = False  # over the runs that are not lost
    kept: bool = False  # 0 in the runs that are lost
    point: Literal["last", "lag"] | int | None = (
        None  # about x_j of the scenario's point: last estimate, curve over the lag, or one lag
    )
    needs: frozenset[str] = frozenset()  # what it must know beyond measurements and estimates: truth, record

    @property
    def better(self) -> Better | None:
        """Whether a small or a large mean is the better one; None where neither is, or an own metric does not say."""
        found: Better | None = getattr(self.quantity, "better", None)
        return found

    def ks(self, T: int) -> NDArray[np.intp]:
        """The steps that enter; of a curve over the lag all lags that there may be, from 0."""
        if self.point is not None:
            return np.arange(T)
        ks = self.quantity.steps(T)
        return ks if self.at is None else ks[(ks >= self.at[0]) & (ks <= self.at[1])]

    def __call__(self, trial: Trial) -> Array:
        """One value a run (M,), or the curve (K, M)."""
        names = trial.experiment.model.states
        states = tuple(names.index(name) for name in self.states or names)
        with np.errstate(all="ignore"):
            values = trial.quantity(self.quantity, states)
            if self.point is not None:
                values = self._about_point(values, trial)
            elif self.at is not None:
                ks = self.quantity.steps(len(trial.estimate.mean))
                values = values[(ks >= self.at[0]) & (ks <= self.at[1])]
            values = np.broadcast_to(values, (len(values), trial.world.y.shape[2]))
            return np.asarray(values if self.curve else _REDUCE[self.reduce](values))

    def _about_point(self, values: Array, trial: Trial) -> Array:
        """What is asked of the values: those of a smoother run over the lag, those of a filter over the steps."""
        if trial.estimate.target is None:
            j, _ = trial.experiment.point or (0, 0)
            return values[j - 1 : j]
        if self.point == "lag":
            return values
        if self.point == "last":
            return values[-1:]
        return values[self.point :][:1]


def over_time(function: Callable[..., NDArray[Any]], *arrays: Array) -> NDArray[Any]:
    """function(A, ...), which treats runs (..., M) alike, at every step of arrays (T, ..., M or 1): (T, ..., M).

    Some steps at a time, side by side as if they were more runs.
    """
    T, M = len(arrays[0]), max(A.shape[-1] for A in arrays)
    some = max(1, TOGETHER // M)

    def columns(A: Array) -> Array:
        A = np.moveaxis(A, 0, -2)
        return np.broadcast_to(A, (*A.shape[:-1], M)).reshape(*A.shape[:-2], -1)

    def steps(A: NDArray[Any]) -> NDArray[Any]:
        return np.moveaxis(A.reshape(*A.shape[:-1], -1, M), -2, 0)

    starts = range(0, T, some)
    return np.concatenate([steps(function(*(columns(A[k : k + some]) for A in arrays))) for k in starts])


def outliers(trial: Trial) -> NDArray[np.bool_]:
    """Whether any component of the measurement of a step is an outlier, (T, M)."""
    flags, y = trial.world.v.flags, trial.world.y
    if flags is None:
        return np.zeros((len(y), y.shape[2]), dtype=bool)
    return np.asarray(flags if flags.ndim == 2 else flags.any(axis=1))
