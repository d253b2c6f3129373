"""Own filters: which of the three kinds a named function or class is, and the catalogue's batch-last interface guarded.

Which one it is, the parameters of the named function or class say:

    model, y, x0, P0, Q, R     a function of one whole run: means (T, n), or (means, covariances (T, n, n))
    model, x0, P0, Q, R        a filter of one run, an object with x, P, predict() and update(y)
    neither                    a filter of the catalogue's kind, an object with `run` over all runs at once

All other parameters are the scenario's. One run is given y (T, m) or (m,), x0 (n,), P0, Q and R; model.f(x, k) and the
other functions of a model serve a single x (n,) as well. predict(k, Q) and update(y, k, R) are given what they ask for
by these names (see `onerun`), and whatever is named `rng` is a numpy Generator of the run's own.

`limits` of the named function or class, a tuple of `rkfbench.catalogue.Limit`, are settings in which it must equal
another filter: `rkfbench check` tries them. `needs = {"streams"}` says that a batch filter draws random numbers.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known, Setting
from rkfbench.filters.smoothing import placed
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.own.faults import PluginFault, raised
from rkfbench.own.onerun import OneByOne, buried, unchanged
from rkfbench.streams import Streams

RUN = ("model", "y", "x0", "P0")
OPTIONS = ("Q", "R", "keep", "known", "streams")
WHOLE = ("model", "y", "x0", "P0", "Q", "R")
STEPWISE = ("model", "x0", "P0", "Q", "R")


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

    own: ClassVar[bool] = True
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
        except (Exception, SystemExit) as error:
            raise raised(self.name, error) from error
        unchanged(self.name, given, own)
        T, n, M = len(y), len(model.states), y.shape[2] if y.ndim == 3 else 1
        return sound(self.name, estimate, (T, n, M), keep)


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
