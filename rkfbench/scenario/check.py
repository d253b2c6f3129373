"""Whether a cell makes sense: its shape by the schema, and everything else by making the experiment it describes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rkfbench import metrics, models, noise
from rkfbench.catalogue import build_kind, check
from rkfbench.errors import Key, SpecError, collect, under
from rkfbench.experiment import Experiment as Made
from rkfbench.filters import build as build_filter
from rkfbench.models import truths
from rkfbench.noise import disturbances
from rkfbench.parts import check_measured
from rkfbench.scenario.attached import faults as required
from rkfbench.scenario.attached import with_steps
from rkfbench.scenario.defaults import completed_filter, completed_kinds
from rkfbench.scenario.filters import description, expanded
from rkfbench.scenario.schema import Experiment
from rkfbench.scenario.yaml import Map, Seq, plain

SECTIONS = frozenset(Experiment.model_fields)


class Checker:
    """Checks the cells of one scenario."""

    def __init__(self) -> None:
        self._listed: dict[int, tuple[Seq, Seq, list[Any]]] = {}
        self._tried: set[str] = set()

    def __call__(self, spec: Map, whole: bool = True) -> tuple[Map, dict[str, Any] | None, list[SpecError]]:
        """The cell with its filters one by one, the same as plain data with every default, and what is wrong with it.

        There is no plain data where something is wrong. Without `whole` only the shape is checked.
        """
        faults: list[SpecError] = []
        spec = attempt(faults, lambda: with_steps(spec)) or spec
        faults += required(spec)
        if isinstance(spec.get("filters"), Seq):
            listed = attempt(faults, lambda: self._filters(spec["filters"]), "filters")
            if listed is not None:
                spec = spec.copy()
                spec["filters"], filters = listed
        shape = attempt(faults, lambda: check(Experiment, spec))
        if faults:
            _look_into_parts(spec, faults)
            return spec, None, faults
        completed = completed_kinds(spec) | {"filters": filters}
        data: dict[str, Any] = plain(shape.model_dump(exclude=completed.keys())) | completed
        made = attempt(faults, lambda: Made.of(data)) if whole else None
        if made is not None:
            attempt(faults, lambda: check_measured(made.metrics, made.filters))
            self._try_metrics(made, faults)
        return spec, None if faults else data, faults

    def _try_metrics(self, made: Made, faults: list[SpecError]) -> None:
        """Own metrics, each tried in the first cell that has it."""
        for i, metric in enumerate(made.metrics):
            if metric.name not in self._tried and getattr(metric.quantity, "own", False):
                from rkfbench.own.parts import try_metric

                attempt(faults, lambda: try_metric(metric, made), "metrics", i)  # noqa: B023
            self._tried.add(metric.name)

    def _filters(self, written: Seq) -> tuple[Seq, list[Any]]:
        """The filters one by one, with marks and as plain data with defaults; once for all cells that share them."""
        if id(written) not in self._listed:
            listed = expanded(written)
            self._listed[id(written)] = written, listed, [completed_filter(each) for each in listed]
        return self._listed[id(written)][1:]


def attempt(faults: list[SpecError], make: Callable[[], Any], *place: Key) -> Any:
    """What `make` makes; None where it raises SpecError, which goes to the faults."""
    with collect(faults), under(*place):
        return make()
    return None


def _look_into_parts(spec: Map, faults: list[SpecError]) -> None:
    """The faults of the parts that can be made one by one, for a cell that cannot be made as a whole."""
    model = attempt(faults, lambda: models.build(spec["model"]), "model") if "model" in spec else None
    for key, components in {"process_noise": "states", "measurement_noise": "measurements"}.items():
        if spec.get(key) is None:
            continue
        if model is None:
            attempt(faults, lambda: build_kind(noise.LAWS, "noise law", spec[key]), key)  # noqa: B023
        else:
            attempt(faults, lambda: noise.build(spec[key], len(getattr(model, components))), key)  # noqa: B023
    if isinstance(spec.get("truth"), dict):
        attempt(faults, lambda: truths.build(spec["truth"]), "truth")
    for index, each in enumerate(_list(spec, "disturbances")):
        attempt(faults, lambda: disturbances.build(each), "disturbances", index)  # noqa: B023
    for index, each in enumerate(_list(spec, "filters")):
        if isinstance(each, dict) and "label" in each:
            attempt(faults, lambda: build_filter(description(each)), "filters", index)  # noqa: B023
    for index, each in enumerate(_list(spec, "metrics")):
        if isinstance(each, str):
            attempt(faults, lambda: metrics.get(each), "metrics", index)  # noqa: B023


def _list(spec: Map, key: str) -> list[Any]:
    value = spec.get(key)
    return value if isinstance(value, list) else []
