"""What recorded data means for an experiment: the laws that filters may assume, times that differ from step to step,
and what nobody knows, so that no filter and no metric may need it.

Every function raises SpecError with the path of a fault within the whole description, as `parts` does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from typing import Any

import numpy as np

from rkfbench import filters, metrics, parts, recording
from rkfbench.errors import SpecError, under
from rkfbench.linalg import Array
from rkfbench.metrics import Metric
from rkfbench.models import Model
from rkfbench.models.timed import has_dt
from rkfbench.noise import Law, Sample
from rkfbench.noise.gaussian import Gaussian
from rkfbench.noise.matrices import covariance
from rkfbench.parts import Told
from rkfbench.recording import Recording

LACKING = {
    "truth": "the true states, which the recorded data does not have",
    "record": "the record of the noise, which recorded data does not have",
    "flags": "to be told the outliers, which recorded data does not do",
    "streams": "equal time steps, as it draws all process noise from one law",
}


def recording_of(spec: Mapping[str, Any], model: Model) -> Recording | None:
    """The recorded data of an experiment that is not simulated; ScenarioError about the CSV file where it is wrong."""
    if spec.get("data") is None:
        return None
    whole = recording.read(spec["data"], model.measurements, model.states)
    if spec["steps"] > len(whole.y):
        raise SpecError(f"the recording has {len(whole.y)} steps", ["steps"])
    found = whole.head(spec["steps"])
    if np.isnan(found.y).all():
        raise SpecError(f"no measurement at all in {len(found.y)} steps: every cell is empty", ["data", "measurements"])
    return found


def law(spec: Mapping[str, Any], key: str, dim: int) -> Law:
    """The law of a noise. Of recorded data it is what filters may assume: without a law, normal with what they are
    told.
    """
    if spec.get("data") is None or spec.get(key) is not None:
        return parts.law(spec, key, dim)
    name = key.replace("noise", "cov")
    if isinstance(cov := spec["assumed"].get(name, "law"), str):
        raise SpecError(f"is required with recorded data, where no `{key}` says it", ["assumed", name])
    with under("assumed", name):
        return Gaussian.of(covariance(cov, dim))


def intervals_of(model: Model, recorded: Recording | None) -> Array | None:
    """dt at each step (T,), where the times of a recording are irregular; the first step is as long as the model says.

    SpecError where the times do not fit the model: that is a wrong unit, or a model that cannot follow them.
    """
    if recorded is None or recorded.intervals is None or not recorded.intervals.size:
        return None
    steps, dt = recorded.intervals, getattr(model, "dt", None)
    low, high = float(steps.min()), float(steps.max())
    with under("data", "time"):
        if high - low <= recording.JITTER * high:
            if dt is not None and abs(dt - low) > recording.JITTER * dt:
                raise SpecError(f"the recorded time advances by {low:g}, but the model's dt is {dt:g}")
            return None
        if dt is None or not has_dt(model):
            raise SpecError(
                f"the recorded time advances by {low:g} to {high:g}, and this model has no dt to follow it: an own one "
                "must be a dataclass with a field `dt`, which f and F compute with"
            )
        if (np.ptp(steps, axis=1) > recording.JITTER * high).any():
            raise SpecError("the runs have different irregular times: give each a scenario of its own")
        if not low * (1 - recording.JITTER) <= dt <= high * (1 + recording.JITTER):
            raise SpecError(
                f"the recorded time advances by {low:g} to {high:g}, but the model's dt, for which Q is told, is {dt:g}"
            )
    return np.array([dt, *steps[:, 0]])


def paced(told: Told, model: Any, intervals: Array | None) -> Told:
    """Q is told for a step of the model's dt; a step of another length gets it in proportion, (T, n, n, 1)."""
    if intervals is None:
        return told
    return replace(told, Q=told.Q[None, ..., None] * (intervals / model.dt)[:, None, None, None])


def lacking(recorded: Recording | None, irregular: bool) -> frozenset[str]:
    """What no filter and no metric may need."""
    if recorded is None:
        return frozenset()
    unknown = {"record", "flags"} | ({"truth"} if recorded.x is None else set()) | ({"streams"} if irregular else set())
    return frozenset(unknown)


def check_filter(spec: Mapping[str, Any], lacking: Set[str]) -> None:
    """SpecError where a filter, or one inside it, needs what is lacking."""
    for name in _named(spec):
        if missing := filters.FILTERS[name].needs & lacking:
            raise SpecError(f"'{name}' needs {_words(missing)}")


def _named(spec: Any) -> Iterator[str]:
    """The catalogue names in a filter's description, those of filters inside it too."""
    if isinstance(spec, str) and spec in filters.FILTERS:
        yield spec
    elif isinstance(spec, Mapping):
        for key, value in spec.items():
            if key in ("use", "filter"):
                yield from _named(value)
            elif key in filters.FILTERS and isinstance(value, Mapping):
                yield key
                yield from _named(value)


def check_metrics(wanted: Sequence[Metric], lacking: Set[str]) -> None:
    """SpecError for each metric that needs what is lacking, with the names of those that do not."""
    without = ", ".join(name for name, entry in metrics.METRICS.items() if not entry.needs & lacking)
    faults = [
        SpecError(f"'{metric.name}' needs {_words(missing)} (these do not: {without})", ["metrics", i])
        for i, metric in enumerate(wanted)
        if (missing := metric.needs & lacking)
    ]
    if faults:
        raise SpecError.all(faults)


def check_lost(spec: Mapping[str, Any], lacking: Set[str]) -> None:
    """SpecError where lost runs are to be found without a truth."""
    if spec.get("lost") is not None and "truth" in lacking:
        raise SpecError(f"needs {LACKING['truth']}", ["lost"])


def _words(missing: Set[str]) -> str:
    return " and ".join(LACKING[each] for each in sorted(missing))


def unknown(like: Array) -> Sample:
    """Noise of which nothing is known."""

    def cov() -> Array:
        raise SpecError("recorded data has no record of its noise")

    return Sample(np.full(like.shape, np.nan), cov)
