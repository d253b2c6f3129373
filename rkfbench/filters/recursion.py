"""The loop over time that all recursive filters share: predict, update, mark what died, keep what was asked for.

A run whose prior covariance is not positive definite, whose state is not finite or not `plausible` to its model has
failed: from that step on its values are NaN, and no other run is
touched. A missing measurement component (NaN in y) is left out of the update; a wholly missing measurement leaves the
prediction as it is.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters import covariances
from rkfbench.filters.base import Estimate, Posterior
from rkfbench.filters.histories import of_measurement
from rkfbench.linalg import Array, batched, finite, positive_definite, trace
from rkfbench.models import Model, Observed

ROUNDING = 1e-9  # of the trace: far more than an update loses
SEES = frozenset({"cov", "prior_mean", "prior_cov", "nu", "S"})  # what every recursive filter can keep


class Recursive(Protocol):
    """A filter that consists of one prediction and one update a step."""

    def predict(self, model: Model, x: Array, P: Array, k: int, Q: Array) -> tuple[Array, ...]:
        """Mean and covariance at k before y_k, from those after y_{k-1}, and arrays (..., M) to hand to `correct`, if
        any.
        """
        ...

    def correct(self, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *handed: Array) -> Posterior:
        """Mean and covariance after y (m, M)."""
        ...


class Step(NamedTuple):
    """One step: mean and covariance before y_k and after it, and what was seen in the update, by name."""

    prior_x: Array
    prior_P: Array
    x: Array
    P: Array
    seen: Mapping[str, Array]


def run(
    filt: Recursive, model: Model, y: Array, x0: Array, P0: Array, Q: Array, R: Array, keep: Collection[str]
) -> Estimate:
    """The estimates of a recursive filter; arguments and shapes as in `Filter.run`."""
    return collect(steps(filt, model, *prepare(model, y, x0, P0, Q, R)), keep, len(y))


def collect(steps: Iterable[Step], keep: Collection[str], T: int) -> Estimate:
    """The estimates that the T steps of a filter make."""
    history = History(keep, T)
    with np.errstate(all="ignore"):
        for each in steps:
            history.add(prior_mean=each.prior_x, prior_cov=each.prior_P, mean=each.x, cov=each.P, **each.seen)
    return history.estimate(failed=np.isnan(each.x).any(0))


def steps(filt: Recursive, model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> Iterator[Step]:
    """The steps k = 1..T one after the other, from arguments as `prepare` makes them."""
    incomplete = np.asarray(np.isnan(y).any(axis=(1, 2)))
    plausible = getattr(model, "plausible", None)
    floor = float(np.linalg.eigvalsh(Q[..., 0])[0]) if Q.shape[-1] == 1 and Q.ndim == 3 else 0.0
    spread = np.inf  # largest trace of the last prior covariances
    for k, yk in enumerate(y, 1):
        prior_x, prior_P, *handed = filt.predict(model, x, P, k, Q[k - 1] if Q.ndim == 4 else Q)
        before, spread = spread, float(trace(prior_P).max())
        update = _correct_observed if incomplete[k - 1] else _correct
        x, P, seen = update(filt, model, prior_x, prior_P, yk, k, R[k - 1] if R.ndim == 4 else R, *handed)
        sound: Any = np.True_
        # An update leaves P semidefinite but for rounding, which is small against the traces of the priors now and
        # before; where the smallest eigenvalue of Q is larger than that by far, F P F' + Q needs no look at its pivots.
        if not ROUNDING * (spread + before) < floor:
            sound = positive_definite(prior_P)
        if not finite(x):
            sound = sound & np.isfinite(x).all(0)
        if plausible is not None:  # the model knows what is not of its world, before and after the update
            sound = sound & plausible(prior_x, prior_P) & plausible(x, P) & positive_definite(P)
        x, P = bury(x, P, sound)
        yield Step(prior_x, prior_P, x, P, seen)


def prepare(
    model: Model, y: Array, x0: Array, P0: Array, Q: Array, R: Array, recorded: bool = False
) -> tuple[Array, Array, Array, Array, Array]:
    """The arguments of `run` with a run axis each; SpecError where a shape does not fit the model, or where what all
    runs share is not finite or no covariance.

    recorded: Q and R come from the record of the noise, which may have none at times.
    """
    n, m = len(model.states), len(model.measurements)
    y = np.asarray(y, dtype=float)
    y = y[..., None] if y.ndim == 2 else y
    if y.ndim != 3 or y.shape[1] != m or not len(y):
        raise SpecError(f"y has shape {y.shape}, expected (T, {m}, M) or (T, {m})")
    T, _, M = y.shape
    x = np.asarray(x0, dtype=float)
    x = x[:, None] if x.ndim == 1 else x
    if x.shape not in ((n, 1), (n, M)):
        raise SpecError(f"x0 has shape {np.shape(x0)}, expected ({n},) or ({n}, {M})")
    if x.shape[1] == 1 and not np.isfinite(x).all():
        raise SpecError("x0 is not finite")
    P0, Q, R = (batched(np.asarray(A, dtype=float)) for A in (P0, Q, R))
    for name, A, d in (("P0", P0, n), ("Q", Q, n), ("R", R, m)):
        if A.shape[-3:-1] != (d, d) or A.shape[-1] not in (1, M) or (A.ndim == 4 and len(A) not in (1, T)):
            raise SpecError(
                f"{name} has shape {A.shape}, expected ({d}, {d}), "
                f"or ({T}, {d}, {d}, {M} or 1) where it changes with time"
            )
        if not recorded or name == "P0":
            covariances.check(name, A, singular=name != "R")
    Q, R = (A[0] if A.ndim == 4 and len(A) == 1 else A for A in (Q, R))
    return y, np.array(np.broadcast_to(x, (n, M))), P0, Q, R


class History:
    """Keeps the arrays of each step that are worth keeping, time first."""

    def __init__(self, keep: Iterable[str], steps: int) -> None:
        self.names, self.steps, self.k = ("mean", *keep), steps, 0
        self.arrays: dict[str, Array] = {}

    def add(self, **arrays: Array) -> None:
        """The arrays of one step; what is not among them is NaN there."""
        for name in self.names:
            if name in arrays:
                self._room(name, arrays[name])[self.k] = arrays[name]
            elif name in self.arrays:
                self.arrays[name][self.k] = np.nan
        self.k += 1

    def _room(self, name: str, step: Array) -> Array:
        """Where the steps of an array go; written out for all runs as soon as they no longer share it."""
        room = self.arrays.get(name)
        if room is None:
            room = self.arrays[name] = np.empty((self.steps, *step.shape))
            room[: self.k] = np.nan
        elif room.shape[-1] < step.shape[-1]:
            room = self.arrays[name] = np.repeat(room, step.shape[-1], axis=-1)
        return room

    def estimate(self, failed: Any) -> Estimate:
        """What was kept."""
        missing = {*self.names} - self.arrays.keys()
        if missing:
            raise SpecError(f"this filter has no history of {', '.join(sorted(missing))}")
        arrays = {**self.arrays}
        return Estimate(arrays.pop("mean"), arrays.pop("cov", None), failed, arrays)


def bury(x: Array, P: Array, sound: Array) -> tuple[Array, Array]:
    """NaN in the runs that are not sound. A covariance that all runs share stays as it is: its shape decides how it
    rounds.
    """
    if sound.all():
        return x, P
    return np.where(sound, x, np.nan), np.where(sound, P, np.nan) if P.shape[-1] == x.shape[-1] else P


def _correct(
    filt: Recursive, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *handed: Array
) -> Posterior:
    return filt.correct(model, x, P, y, k, R, *handed)


def _correct_observed(
    filt: Recursive, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *handed: Array
) -> Posterior:
    """The update with the observed components only, one pattern of missing components after the other."""
    observed = ~np.isnan(y)
    patterns, which = np.unique(observed, axis=1, return_inverse=True)
    which = which.reshape(-1)
    shared = P.shape[-1] == 1 and patterns.shape[1] > 1
    x, P = x.copy(), np.array(np.broadcast_to(P, (*P.shape[:2], y.shape[1]))) if shared else P.copy()
    seen: dict[str, Array] = {}
    for i, pattern in enumerate(patterns.T):
        if not pattern.any():
            continue
        runs, rows = np.flatnonzero(which == i), np.flatnonzero(pattern)
        view = _runs(P, runs), _runs(R, runs)[np.ix_(rows, rows)]
        of_runs = (_runs(A, runs) for A in handed)
        after = filt.correct(Observed(model, rows), x[:, runs], view[0], y[np.ix_(rows, runs)], k, view[1], *of_runs)
        x[:, runs] = after.x
        if P.shape[-1] == 1 < after.P.shape[-1]:
            P = np.array(np.broadcast_to(P, (*P.shape[:2], y.shape[1])))
        P[..., runs if P.shape[-1] > 1 else slice(None)] = after.P
        for name, value in after.seen.items():
            _scatter(seen, name, value, rows, runs, y.shape)
    return Posterior(x, P, seen)


def _runs(A: Array, runs: Array) -> Array:
    return A if A.shape[-1] == 1 else A[..., runs]


def _scatter(seen: dict[str, Array], name: str, value: Array, rows: Array, runs: Array, shape: tuple[int, ...]) -> None:
    """Put what was seen of the observed components at their places; the missing ones are NaN."""
    m, M = shape
    axes = [(length, of_measurement(name, length, len(rows))) for length in value.shape[:-1]]
    full = seen.setdefault(name, np.full((*(m if measured else length for length, measured in axes), M), np.nan))
    places = [rows if measured else np.arange(length) for length, measured in axes]
    full[np.ix_(*places, runs)] = value
