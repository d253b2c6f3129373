"""Filters of one run, taken over the runs one after the other: textbook objects with predict and update, and functions
of a whole run.

predict and update are given k if they have a parameter k; predict the Q of the step and update its R if they ask for it
by a parameter Q or R. One with a default is given only where Q or R changes with time (irregular times of a recording),
where a filter that does not ask for it is refused.

The innovation nu = y - h(x-) and its covariance S = H P- H' + R are formed from what is predicted, with the R that is
told; a filter that has `nu` (m,) and `S` (m, m) after its update is believed instead.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known
from rkfbench.filters.recursion import prepare
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.own.faults import PluginFault, raised, said
from rkfbench.streams import GROUP, Streams

METHODS = {"predict": ("k", "Q"), "update": ("k", "R")}  # what each is given if it has a parameter of that name
CHANGED = "changes its argument {} in place (x = x + d instead of x += d leaves it as it is)"
STEP = 6e-6  # of a central difference, relative: the cube root of the rounding


class Died(Exception):
    """A run is numerically dead; the text says how."""


@dataclass(frozen=True)
class OneByOne:
    """A filter of one run, taken over the runs one after the other."""

    own: ClassVar[bool] = True
    name: str
    make: Callable[..., Any]
    params: Mapping[str, Any]
    given: tuple[str, ...]
    only: int | None = None  # how many runs of a batch are wanted; the others are left out, as if they had failed
    begin: int = 0  # number of the batch's first run within the streams

    def first(self, runs: int) -> OneByOne:
        """The filter for the first runs of a batch: no run depends on those beside it."""
        return replace(self, only=runs)

    def check(self, model: Model) -> None:
        """SpecError if the filter's own check(model), where it has one, refuses the model."""
        own: Callable[[Model], None] | None = getattr(self.make, "check", None)
        if own is not None:
            own(model)

    def check_told(self, Q: Array, R: Array) -> None:
        """SpecError if Q or R changes with time and the filter is known to have no place for that of a step."""
        self._check_told(self.make, Q, R)

    def _check_told(self, filt: Any, Q: Array, R: Array) -> None:
        for what, A, method in (("Q", Q, "predict"), ("R", R, "update")):
            if A.ndim < 4:
                continue
            if "y" in self.given:
                raise SpecError(
                    f"{what} changes with time here, and {self.name}, a function of a whole run, is given one for all "
                    "steps: write an object with predict(k, Q) and update(y, k, R), or a filter of all runs, which is "
                    f"given {what} of every step"
                )
            if hasattr(filt, method) and what not in inspect.signature(getattr(filt, method)).parameters:
                raise SpecError(
                    f"{what} changes with time here, and {method} of {self.name} has no parameter {what}: write "
                    f"{'predict(self, k, Q)' if what == 'Q' else 'update(self, y, k, R)'}, which is given that of each "
                    "step"
                )

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return frozenset({"cov"} if "y" in self.given else {"cov", "prior_mean", "prior_cov", "nu", "S"})

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
        self.check_told(Q, R)
        (T, m, M), n = y.shape, len(x0)
        shapes = {"mean": (n,), "cov": (n, n), "prior_mean": (n,), "prior_cov": (n, n), "nu": (m,), "S": (m, m)}
        kept = {key: np.full((T, *shapes[key], M), np.nan) for key in shapes if key == "mean" or key in keep}
        before = self.begin + (streams.first * GROUP if streams is not None else 0)
        death = ""
        with np.errstate(all="ignore"):
            for i in range(M if self.only is None else min(M, self.only)):
                given: dict[str, Any] = {"model": model, "y": y[..., i], "x0": x0[:, i]}
                if "rng" in self.given:
                    given["rng"] = generator(streams, self.begin + i)
                given |= {key: A[..., min(i, A.shape[-1] - 1)] for key, A in (("P0", P0), ("Q", Q), ("R", R))}
                own = {key: each.copy() if isinstance(each, np.ndarray) else each for key, each in given.items()}
                place = f" in run {before + i}"
                try:
                    for k, step in enumerate(self._steps(own, place, kept.keys()), 1):
                        for key, value in step.items():
                            if key in kept:
                                kept[key][k - 1, ..., i] = value
                except Died as how:  # counted, as with any filter
                    death = death or str(how).removeprefix(" in ")
                unchanged(f"{self.name}{place}", given, own)
        mean, failed = buried(kept.pop("mean"))
        return Estimate(mean, kept.pop("cov", None), failed, kept, death=death)

    def _steps(self, own: Mapping[str, Any], place: str, keep: Collection[str]) -> Iterator[Mapping[str, Any]]:
        """What is known after each step of one run; Died after the last one that is worth anything."""
        arguments = {key: _at(own[key], 1) for key in self.given}
        made = self._called(place, self.make, **arguments, **self.params)
        if "y" in self.given:
            return self._rows(made, own["y"], len(own["x0"]), place)
        return self._recursed(made, own, place, keep)

    def _recursed(
        self, filt: Any, own: Mapping[str, Any], place: str, keep: Collection[str]
    ) -> Iterator[Mapping[str, Any]]:
        """An object with predict and update, step after step."""
        for method in METHODS:
            if not callable(getattr(filt, method, None)):
                raise PluginFault(f"{self.name} makes a {type(filt).__name__}, which has no method {method}")
        self._check_told(filt, own["Q"][..., None], own["R"][..., None])
        asked = {method: _asked(getattr(filt, method), names, own) for method, names in METHODS.items()}
        n = len(own["x0"])
        for k, y in enumerate(own["y"], 1):
            where = f"{place}, step {k}"
            told = {"k": k, "Q": _at(own["Q"], k), "R": _at(own["R"], k)}
            self._called(where, filt.predict, **{key: told[key] for key in asked["predict"]})
            x, P = self._state(filt, n, where)
            step = {"prior_mean": x, "prior_cov": P}
            if not np.isnan(y).all():  # what is wholly missing is a prediction only
                self._called(where, filt.update, y, **{key: told[key] for key in asked["update"]})
                if "nu" in keep or "S" in keep:
                    step |= shown(filt, y) or innovation(own["model"], x, P, y, k, told["R"])
            step["mean"], step["cov"] = self._state(filt, n, where)
            yield step
            for what, value in (("x", step["mean"]), ("P", step["cov"])):
                if not np.isfinite(value).all():
                    raise Died(f"{where}: {what} is not finite{_partly(y)}")

    def _rows(self, result: Any, y: Array, n: int, place: str) -> Iterator[Mapping[str, Any]]:
        """The result of a function of a whole run, step after step."""
        T, name = len(y), self.name + place
        if isinstance(result, tuple) and len(result) not in (2, T):  # T rows are means
            raise PluginFault(
                f"{name} returned {len(result)} values, expected means {(T, n)}, or means and covariances {(T, n, n)}"
            )
        means, covs = result if isinstance(result, tuple) and len(result) == 2 else (result, None)
        if means is None:
            raise PluginFault(f"{name} returned None, expected means {(T, n)}, or means and covariances: no return?")
        arrays = {"mean": _floats(name, "means", means)}
        if covs is not None:
            arrays["cov"] = _floats(name, "covariances", covs)
        for key, value in arrays.items():
            shape = (T, n) if key == "mean" else (T, n, n)
            if value.shape != shape:
                raise PluginFault(f"{name} returned {key}s of shape {value.shape}, expected {shape}")
        for k in range(T):
            yield {key: value[k] for key, value in arrays.items()}
            if not np.isfinite(arrays["mean"][k]).all():
                raise Died(f"{place}, step {k + 1}: the mean is not finite{_partly(y[: k + 1])}")

    def _called(self, place: str, function: Callable[..., Any], *arguments: Any, **named: Any) -> Any:
        try:
            return function(*arguments, **named)
        except np.linalg.LinAlgError as error:
            raise Died(f"{place}: {said(error)}") from error
        except (Exception, SystemExit) as error:
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


def shown(filt: Any, y: Array) -> dict[str, Array] | None:
    """nu and S that a filter has after its update, of all components or of those measured; None where it lacks one, or
    means something of another shape by the name. NaN where a component is missing.
    """
    there, found = ~np.isnan(y), {}
    for name, axes in (("nu", 1), ("S", 2)):
        value, full = np.asarray(getattr(filt, name, None)), (len(y),) * axes
        if name == "nu" and value.ndim == 2 and value.shape[1] == 1:
            value = value[:, 0]
        if value.shape not in (full, (int(there.sum()),) * axes):
            return None
        place = np.ix_(*(there,) * axes)
        found[name] = np.full(full, np.nan)
        found[name][place] = value[place] if value.shape == full else value
    return found


def innovation(model: Model, x: Array, P: Array, y: Array, k: int, R: Array) -> dict[str, Array]:
    """nu = y - h(x) and S = H P H' + R of one run, x (n,) and P (n, n) being what is predicted; NaN where a component
    of y is missing.
    """
    nu = np.array(model.residual(np.array(y), model.h(x, k)))
    H = _slope(model, x, k)
    there = ~np.isnan(nu)
    return {"nu": nu, "S": np.where(there[:, None] & there, H @ P @ H.T + R, np.nan)}


def _slope(model: Model, x: Array, k: int) -> Array:
    """H (m, n) at x (n,); by central differences where the model has none."""
    if hasattr(model, "H"):
        return np.asarray(model.H(x, k))
    d = STEP * np.maximum(1.0, np.abs(x))
    return np.asarray(
        model.residual(model.h(x[:, None] + np.diag(d), k), model.h(x[:, None] - np.diag(d), k)) / (2 * d)
    )


def _asked(method: Callable[..., Any], names: Collection[str], told: Mapping[str, Any]) -> list[str]:
    """What a method is given: k, and the Q or R that it requires, or has a default for that does not hold at all
    steps.
    """
    parameters = inspect.signature(method).parameters
    wanted = [name for name in names if name in parameters]
    return [
        name
        for name in wanted
        if name == "k" or parameters[name].default is inspect.Parameter.empty or told[name].ndim == 3
    ]


def _at(value: Any, k: int) -> Any:
    """An argument as it is at step k: of a Q or R that changes with time that of the step."""
    return value[k - 1] if isinstance(value, np.ndarray) and value.ndim == 3 else value


def _partly(y: Array) -> str:
    """A hint where a filter may have computed with a missing component."""
    missing = np.isnan(y)
    return " (y has missing components, NaN: use those where np.isfinite(y))" if missing.any() else ""


def _floats(name: str, what: str, value: Any, where: str = "") -> Array:
    if np.iscomplexobj(value):
        raise PluginFault(f"{name} has complex {what}{where}: give its real part, if that is what is meant")
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


def buried(mean: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Means with NaN in a run from the first value on that is no finite number, and the runs that have one."""
    dead = np.logical_or.accumulate(~np.isfinite(mean).all(1, keepdims=True), axis=0)
    return (np.where(dead, np.nan, mean) if dead.any() else mean), np.asarray(dead.any((0, 1)))
