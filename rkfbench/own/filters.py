"""Own filters: the batch-last interface of the catalogue, and textbook filters of one run looped over the runs.

Which one it is, the parameters of the named function or class say:

    model, y, x0, P0, Q, R     a function of one whole run: means (T, n), or (means, covariances (T, n, n))
    model, x0, P0, Q, R        a filter of one run, an object with x, P, predict() and update(y)
    neither                    a filter of the catalogue's kind, an object with `run` over all runs at once

All other parameters are the scenario's. One run is given y (T, m) or (m,), x0 (n,), P0, Q and R; model.f(x, k) and the
other functions of a model serve a single x (n,) as well. predict and update are given k if they have a parameter k, and
whatever is named `rng` is a numpy Generator of the run's own.

`limits` of the named function or class, a tuple of `rkfbench.catalogue.Limit`, are settings in which it must equal
another filter: `rkfbench check` tries them. `needs = {"streams"}` says that a batch filter draws random numbers.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known, Setting
from rkfbench.filters.recursion import prepare
from rkfbench.filters.smoothing import placed
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.own.faults import PluginFault, raised
from rkfbench.streams import GROUP, Streams

RUN = ("model", "y", "x0", "P0")
OPTIONS = ("Q", "R", "keep", "known", "streams")
WHOLE = ("model", "y", "x0", "P0", "Q", "R")
STEPWISE = ("model", "x0", "P0", "Q", "R")
CHANGED = "changes its argument {} in place (x = x + d instead of x += d leaves it as it is)"


def adapted(
    name: str, target: Any, signature: Collection[str]
) -> tuple[Callable[[Mapping[str, Any]], Any], tuple[str, ...]]:
    """How the named function or class becomes a filter, and which of its parameters are not the scenario's."""
    if "model" not in signature:
        return (lambda params: Guarded(name, _with_run(name, target(**params)))), ()
    wanted = WHOLE if "y" in signature else STEPWISE
    if lacking := [each for each in wanted if each not in signature]:
        raise SpecError(
            f"{name} lacks the parameters {', '.join(lacking)}: a filter of one run is a function of "
            f"({', '.join(WHOLE)}), or an object with predict and update made from ({', '.join(STEPWISE)})"
        )
    if wanted == STEPWISE and inspect.isclass(target):
        for method in ("predict", "update"):
            if not callable(getattr(target, method, None)):
                raise SpecError(f"{name} has no method {method}")
    given = (*wanted, "rng") if "rng" in signature else wanted
    return (lambda params: OneByOne(name, target, dict(params), given)), given


def _with_run(name: str, made: Any) -> Any:
    run = getattr(made, "run", None)
    if not callable(run):
        raise SpecError(
            f"{name} makes a {type(made).__name__}, which has no `run`; a filter of one run has the parameters "
            f"{', '.join(WHOLE)} or {', '.join(STEPWISE)}"
        )
    try:
        inspect.signature(run).bind(*RUN, **dict.fromkeys(OPTIONS))
    except TypeError as error:
        raise SpecError(
            f"`run` of {name} cannot be called as run({', '.join(RUN)}, *, {', '.join(OPTIONS)}): {error}"
        ) from error
    return made


@dataclass(frozen=True)
class Guarded:
    """A batch filter whose results are checked, and whose arguments are copies."""

    name: str
    filter: Any

    def __getattr__(self, name: str) -> Any:
        if name in ("name", "filter") or name.startswith("__"):
            raise AttributeError(name)
        return getattr(self.filter, name)

    def placed(self, setting: Setting) -> Guarded:
        """The filter with what an experiment tells it."""
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
        """The estimates; PluginFault when the filter raises or breaks the contract."""
        given = {"y": y, "x0": x0, "P0": P0, "Q": Q, "R": R}
        own = {key: np.array(value, dtype=float) for key, value in given.items()}
        try:
            estimate = self.filter.run(model, **own, keep=keep, known=known, streams=streams)
        except Exception as error:
            raise raised(self.name, error) from error
        unchanged(self.name, given, own)
        T, n, M = len(y), len(model.states), y.shape[2] if y.ndim == 3 else 1
        return sound(self.name, estimate, (T, n, M), keep)


@dataclass(frozen=True)
class OneByOne:
    """A filter of one run, taken over the runs one after the other."""

    name: str
    make: Callable[..., Any]
    params: Mapping[str, Any]
    given: tuple[str, ...]
    only: int | None = None  # how many runs of a batch are wanted; the others are left out, as if they had failed

    def first(self, runs: int) -> OneByOne:
        """The filter for the first runs of a batch: no run depends on those beside it."""
        return replace(self, only=runs)

    def check(self, model: Model) -> None:
        """SpecError if the filter's own check(model), where it has one, refuses the model."""
        own: Callable[[Model], None] | None = getattr(self.make, "check", None)
        if own is not None:
            own(model)

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return frozenset({"cov"}) if "y" in self.given else frozenset({"cov", "prior_mean", "prior_cov"})

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
        """The estimates; PluginFault when the filter raises (but for a LinAlgError, by which its run has failed) or
        breaks the contract.
        """
        y, x0, P0, Q, R = prepare(model, y, x0, P0, Q, R)
        (T, _, M), n = y.shape, len(x0)
        shapes = {"mean": (n,), "cov": (n, n), "prior_mean": (n,), "prior_cov": (n, n)}
        kept = {key: np.full((T, *shapes[key], M), np.nan) for key in shapes if key == "mean" or key in keep}
        before = streams.first * GROUP if streams is not None else 0
        with np.errstate(all="ignore"):
            for i in range(M if self.only is None else min(M, self.only)):
                given: dict[str, Any] = {"model": model, "y": y[..., i], "x0": x0[:, i]}
                if "rng" in self.given:
                    given["rng"] = generator(streams, i)
                given |= {key: A[..., min(i, A.shape[-1] - 1)] for key, A in (("P0", P0), ("Q", Q), ("R", R))}
                own = {key: each.copy() if isinstance(each, np.ndarray) else each for key, each in given.items()}
                place = f" in run {before + i}"
                try:
                    for k, step in enumerate(self._steps(own, place), 1):
                        for key, value in step.items():
                            if key in kept:
                                kept[key][k - 1, ..., i] = value
                except np.linalg.LinAlgError:  # numerically dead: counted, as with any filter
                    continue
                unchanged(f"{self.name}{place}", given, own)
        mean, failed = buried(kept.pop("mean"))
        return Estimate(mean, kept.pop("cov", None), failed, kept)

    def _steps(self, own: Mapping[str, Any], place: str) -> Iterator[Mapping[str, Any]]:
        """What is known after each step of one run."""
        arguments = {key: own[key] for key in self.given}
        T, n = len(own["y"]), len(own["x0"])
        if "y" in self.given:
            result = self._called(place, self.make, **arguments, **self.params)
            means, covs = result if isinstance(result, tuple) else (result, None)
            yield from _rows(self.name + place, T, n, mean=means, cov=covs)
            return
        filt = self._called(place, self.make, **arguments, **self.params)
        for method in ("predict", "update"):
            if not callable(getattr(filt, method, None)):
                raise PluginFault(f"{self.name} makes a {type(filt).__name__}, which has no method {method}")
        timed = {method: "k" in inspect.signature(getattr(filt, method)).parameters for method in ("predict", "update")}
        for k, y in enumerate(own["y"], 1):
            where = f"{place}, step {k}"
            self._called(where, filt.predict, **({"k": k} if timed["predict"] else {}))
            prior = self._state(filt, n, where)
            if not np.isnan(y).all():  # what is wholly missing is a prediction only
                self._called(where, filt.update, y, **({"k": k} if timed["update"] else {}))
            post = self._state(filt, n, where)
            yield {"prior_mean": prior[0], "prior_cov": prior[1], "mean": post[0], "cov": post[1]}
            if not (np.isfinite(post[0]).all() and np.isfinite(post[1]).all()):  # the run is dead: it has failed
                return

    def _called(self, place: str, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except np.linalg.LinAlgError:
            raise
        except Exception as error:
            raise raised(self.name, error, place) from error

    def _state(self, filt: Any, n: int, where: str) -> tuple[Array, Array]:
        """x and P of a filter as they are now."""
        state = []
        for key, shape in (("x", (n,)), ("P", (n, n))):
            if not hasattr(filt, key):
                raise PluginFault(f"{self.name} has no attribute {key}{where}")
            value = _floats(self.name, key, getattr(filt, key), where)
            if value.shape == (n, 1) and key == "x":
                value = value[:, 0]
            if value.shape != shape:
                raise PluginFault(f"{self.name} has {key} of shape {value.shape}{where}, expected {shape}")
            state.append(np.array(value))
        return state[0], state[1]


def _rows(name: str, T: int, n: int, **results: Any) -> Iterator[Mapping[str, Any]]:
    """The result of a whole run step by step."""
    arrays = {key: _floats(name, key, value) for key, value in results.items() if value is not None}
    for key, value in arrays.items():
        shape = (T, n) if key == "mean" else (T, n, n)
        if value.shape != shape:
            raise PluginFault(f"{name} returned {key}s of shape {value.shape}, expected {shape}")
    for k in range(T):
        yield {key: value[k] for key, value in arrays.items()}


def _floats(name: str, what: str, value: Any, where: str = "") -> Array:
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise PluginFault(f"{name} has {what} that is not an array of numbers{where}: {error}") from error


def generator(streams: Streams | None, i: int) -> np.random.Generator:
    """The random numbers of run i of a block, the same whatever runs beside it."""
    seed, first, scope = (streams.seed, streams.first, streams.scope) if streams is not None else (0, 0, "")
    key = (crc32(f"{scope}one".encode()), first * GROUP + i)
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=key)))


def unchanged(name: str, given: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """PluginFault if a filter has written into what it was given."""
    for key, value in given.items():
        if isinstance(value, np.ndarray) and not np.array_equal(value, own[key], equal_nan=True):
            raise PluginFault(f"{name} {CHANGED.format(key)}")


def sound(name: str, estimate: Any, shape: tuple[int, int, int], keep: Collection[str]) -> Estimate:
    """The estimate of a batch filter; PluginFault where its shape is wrong. Runs with a mean that is no finite number
    have failed.
    """
    if not isinstance(estimate, Estimate):
        raise PluginFault(f"{name} returned a {type(estimate).__name__}, not an rkfbench.filters.Estimate")
    T, n, M = shape
    times = T if estimate.target is None else len(estimate.mean)
    if np.shape(estimate.mean) != (times, n, M):
        raise PluginFault(f"{name} returned means of shape {np.shape(estimate.mean)}, expected {(times, n, M)}")
    if np.shape(estimate.failed) != (M,):
        raise PluginFault(f"{name} returned `failed` of shape {np.shape(estimate.failed)}, expected {(M,)}")
    of_cov = () if estimate.cov is None else np.shape(estimate.cov)
    if "cov" in keep and of_cov not in ((times, n, n, M), (times, n, n, 1)):
        found = "no covariances" if estimate.cov is None else f"covariances of shape {of_cov}"
        raise PluginFault(f"{name} returned {found}, expected {(times, n, n, M)} or {(times, n, n, 1)}")
    if lacking := set(keep) - {"cov"} - estimate.extras.keys():
        raise PluginFault(f"{name} was asked to keep {', '.join(sorted(lacking))} and did not")
    mean, died = buried(np.asarray(estimate.mean, dtype=float))
    return replace(estimate, mean=mean, failed=np.asarray(estimate.failed, dtype=bool) | died)


def buried(mean: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Means with NaN in a run from the first value on that is no finite number, and the runs that have one."""
    dead = np.logical_or.accumulate(~np.isfinite(mean).all(1, keepdims=True), axis=0)
    return (np.where(dead, np.nan, mean) if dead.any() else mean), np.asarray(dead.any((0, 1)))
