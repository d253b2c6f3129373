"""The parts of an experiment, each made from its description: model, laws, what filters are told, filters, metrics.

Every function raises SpecError with the path of a fault within the whole description.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rkfbench import filters, metrics, models, noise
from rkfbench.errors import SpecError, collect, did_you_mean, under
from rkfbench.filters import Filter, Setting
from rkfbench.linalg import Array
from rkfbench.metrics import Metric
from rkfbench.models import Model, truths
from rkfbench.models.truths import Truth
from rkfbench.noise import Law, disturbances
from rkfbench.noise.disturbances import Disturbance
from rkfbench.noise.matrices import covariance, factor

NOT_BUILD = ("label", "extra", "timing", "assumed")  # keys of a filter's description that are not its own


@dataclass(frozen=True)
class Told:
    """What a filter is told: initial mean (n,) and covariance P0, and the noise covariances Q and R."""

    mean: Array
    P0: Array
    Q: Array
    R: Array


@dataclass(frozen=True)
class Lost:
    """A run is lost when the absolute error of one of the states exceeds the limit: the largest one, or its RMS, over
    steps first..last.
    """

    states: tuple[int, ...]
    limit: float
    first: int
    last: int
    rms: bool

    def __call__(self, error: Array) -> np.ndarray:
        """(T, n, M), or (1, n, M) of one step -> (M,); an error that is not a number counts as lost."""
        e = error[self.first - 1 : self.last, list(self.states)] if len(error) > 1 else error[:, list(self.states)]
        size = np.sqrt((e * e).mean(0)) if self.rms else np.abs(e).max(0)
        return ~(size <= self.limit).all(0)


def models_of(spec: Mapping[str, Any]) -> tuple[Model, Model]:
    """The model of the truth and the one of the filters, which may be told nothing of a known input."""
    known = spec.get("input")
    with under("model"):
        dt = spec["model"].get("dt") if isinstance(spec["model"], Mapping) else None
        if isinstance(dt, float) and not np.isfinite(dt):
            raise SpecError(f"a time step must be finite, not {dt}", ["dt"])
        if known is None or not isinstance(spec["model"], Mapping):  # no mapping: told by the catalogue
            return (model := models.build(spec["model"])), model
        return models.build({**spec["model"], "u": known["value"]}), models.build(
            {**spec["model"], "u": known["value"] * known.get("filters_use_it", True)}
        )


def script_of(spec: Any, model: Model) -> Truth | None:
    if spec == "model":
        return None
    with under("truth"):
        script = truths.build(spec)
        script.check(model.states)
        return script


def disturbance(i: int, spec: Mapping[str, Any], model: Model, steps: int) -> Disturbance:
    with under("disturbances", i):
        built = disturbances.build(spec)
        built.check(model.states if built.channel == "process" else model.measurements, steps)
        return built


def law(spec: Mapping[str, Any], key: str, dim: int) -> Law:
    with under(key):
        return noise.build(spec.get(key) or {"kind": "gaussian", "cov": 0.0}, dim)


def _vector(values: Sequence[float], n: int) -> Array:
    if len(values) != n:
        raise SpecError(f"has {len(values)} elements, the model has {n} states")
    return np.array(values, dtype=float)


def start(spec: Mapping[str, Any], n: int) -> tuple[Array, Array | None]:
    truth = spec["truth"]
    with under("start", "truth"):
        if not isinstance(truth, Mapping):
            return _vector(truth, n), None
        with under("mean"):
            mean = _vector(truth["mean"], n)
        with under("cov"):
            return mean, factor(covariance(truth["cov"], n))


def told(spec: Mapping[str, Any], laws: tuple[Law, Law], n: int, m: int) -> Told:
    faults: list[SpecError] = []
    parts: dict[str, Array] = {}
    makes: dict[str, tuple[str, Callable[[], Array]]] = {
        "mean": ("mean", lambda: _vector(spec["mean"], n)),
        "P0": ("cov", lambda: _positive(covariance(spec["cov"], n))),
        "Q": ("process_cov", lambda: _named_cov(spec.get("process_cov", "law"), laws[0], n)),
        "R": ("measurement_cov", lambda: _positive(_named_cov(spec.get("measurement_cov", "law"), laws[1], m))),
    }
    for name, (key, make) in makes.items():
        with collect(faults), under("assumed", key):
            parts[name] = make()
    if faults:
        raise SpecError.all(faults)
    return Told(**parts)


def _named_cov(spec: Any, law: Law, dim: int) -> Array:
    """A matrix, or the name of a covariance that the law knows of itself."""
    return covariance(spec, dim, {"law": law.cov, **law.parts})


def _positive(C: Array) -> Array:
    if np.linalg.eigvalsh(C)[0] <= 0:
        raise SpecError("the covariance that a filter is told must be positive definite")
    return C


def told_apart(own: Mapping[str, Any], assumed: Mapping[str, Any], laws: tuple[Law, Law], n: int, m: int) -> Told:
    """What a filter is told that has an `assumed` of its own: that of all filters with its changes."""
    return told({**assumed, **{key: value for key, value in own.items() if value is not None}}, laws, n, m)


def filter_of(spec: Mapping[str, Any], model: Model, setting: Setting) -> Filter:
    own = {key: value for key, value in spec.items() if key not in NOT_BUILD}
    built = filters.build(own)
    with under(*(() if "use" in own else own if len(own) == 1 else ())):
        built = filters.placed(built, setting)
        check: Callable[[Model], None] | None = getattr(built, "check", None)
        if check is not None:
            check(model)
    return built


def check_told(filt: Any, told: Told | None) -> None:
    """SpecError if a filter of one run has no place for a Q or R that changes with time."""
    check: Callable[[Array, Array], None] | None = getattr(filt, "check_told", None)
    if check is not None and told is not None:
        check(told.Q, told.R)


def point_of(spec: Mapping[str, Any] | None, steps: int) -> tuple[int, int] | None:
    if spec is None:
        return None
    with under("point"):
        if spec["at"] > steps:
            raise SpecError(f"step {spec['at']} is not within 1..{steps}", ["at"])
        if spec["at"] + spec["lag"] > steps:
            raise SpecError(f"{spec['at']} + {spec['lag']} lies beyond the last step, {steps}", ["lag"])
        return spec["at"], spec["lag"]


def score_of(text: str, model: Model, spec: Mapping[str, Any]) -> str:
    with under("score"):
        metric = _checked(text, model, spec)
        if metric.curve or metric.root or metric.quantity.keep or metric.quantity.partners or metric.name == "score":
            raise SpecError(
                f"'{text}' is not one number a run from the estimates alone, such as rmse or axis_rmse[px,py]"
            )
        return text


def metric(i: int, text: str, model: Model, spec: Mapping[str, Any]) -> Metric:
    with under("metrics", i):
        return _checked(text, model, spec)


def _checked(text: str, model: Model, spec: Mapping[str, Any]) -> Metric:
    steps, point = spec["steps"], spec.get("point")
    metric = metrics.get(text)
    for name in metric.states:
        if name not in model.states:
            raise SpecError(
                f"the model has no state '{name}'{did_you_mean(name, model.states)} (it has {', '.join(model.states)})"
            )
    if metric.at is not None and not 1 <= metric.at[0] <= metric.at[1] <= steps:
        raise SpecError(f"steps {metric.at[0]}..{metric.at[1]} are not within 1..{steps}")
    if metric.point is not None and point is None:
        raise SpecError("`@j` and `@lag` are about a point, and there is no `point` here")
    if point is not None and isinstance(metric.point, int) and metric.point > point["lag"]:
        raise SpecError(f"the lag goes from 0 to {point['lag']}")
    own: Callable[[Model], None] | None = getattr(metric.quantity, "check", None)
    if own is not None:
        own(model)
    if not len(metric.ks(steps)):
        raise SpecError(f"'{text}' has no step within 1..{steps}")
    return metric


def check_partners(wanted: Sequence[Metric], built: Mapping[str, Any]) -> None:
    for i, metric in enumerate(wanted):
        for label in metric.quantity.partners:
            if label not in built:
                raise SpecError(
                    f"'{metric.name}' compares with '{label}', which is no filter here{did_you_mean(label, built)}",
                    ["metrics", i],
                )
            lacking = metric.quantity.partners[label] - getattr(built[label][0], "sees", frozenset())
            if lacking:
                raise SpecError(
                    f"'{metric.name}' needs {', '.join(sorted(lacking))} of '{label}', which it does not have",
                    ["metrics", i],
                )


def check_measured(wanted: Sequence[Metric], built: Mapping[str, Any]) -> None:
    """SpecError if of no filter there is any metric: nothing would be in the tables."""
    of_none = [sentence for label, (filt, _) in built.items() if (sentence := unmeasured(label, filt, wanted, True))]
    if wanted and built and len(of_none) == len(built):
        raise SpecError(f"nothing would be measured: {'; '.join(of_none)}", ["metrics"])


def unmeasured(label: str, filt: Any, wanted: Sequence[Metric], whole: bool = False) -> str:
    """`clipped has no nu, S: nis, whiteness not measured`, or nothing. whole: only if not a single metric is left."""
    missing = {metric.name: each for metric in wanted if (each := metrics.lacking(metric, filt))}
    if not missing or (whole and any(metrics.applies(metric, filt) for metric in wanted)):
        return ""
    histories = dict.fromkeys(name for each in missing.values() for name in sorted(each, reverse=True))
    return f"{label} has no {', '.join(histories)}: {', '.join(missing)} not measured"


def lost_of(spec: Mapping[str, Any] | None, model: Model, steps: int) -> Lost | None:
    if spec is None:
        return None
    with under("lost"):
        for i, name in enumerate(spec["states"]):
            if name not in model.states:
                raise SpecError(f"the model has no state '{name}'{did_you_mean(name, model.states)}", ["states", i])
        first, last = 1, steps
        if spec.get("at") is not None:
            first = last = spec["at"]
        elif spec.get("window") is not None:
            first, last = spec["window"]
        elif spec.get("after") is not None:
            first = spec["after"] + 1
        if not 1 <= first <= last <= steps:
            raise SpecError(f"steps {first}..{last} are not within 1..{steps}")
        states = tuple(model.states.index(name) for name in spec["states"])
        return Lost(states, float(spec["limit"]), first, last, spec.get("statistic") == "rms")
