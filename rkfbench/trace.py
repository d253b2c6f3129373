"""One run of one filter from the inside: truth, measurements, estimates, innovations, and what else the filter shows.

The columns of a trace are k (and t where the model has a time step), then by component

    x_  truth    y_  measurement    xhat_  estimate    sd_  its standard deviation    nu_  innovation    S_a_b  its
    covariance    outlier_  1 where the measurement is one    alpha_, lambda_, ...  what the filter shows of itself

and `failed`, 1 from the step on at which the run died. What nobody knows is not there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench import metrics
from rkfbench.errors import UsageError
from rkfbench.experiment import Experiment, World
from rkfbench.filters import Estimate
from rkfbench.filters.histories import components
from rkfbench.linalg import Array
from rkfbench.scenario.pick import filter_of
from rkfbench.store import blocks
from rkfbench.streams import GROUP, Streams
from rkfbench.study import plan
from rkfbench.study.tune import Bench, check
from rkfbench.study.wide import alone

if TYPE_CHECKING:
    from rkfbench.scenario import Cell, Scenario

HIDDEN = frozenset({"prior_mean", "prior_cov", "passed"})


@dataclass(frozen=True)
class Trace:
    """One run: the columns (T,) by name; names of the states, of the measurements, and of what else the filter shows,
    each with its columns.
    """

    case: str
    filter: str
    run: int
    columns: dict[str, Array]
    states: tuple[str, ...]
    measurements: tuple[str, ...]
    shown: dict[str, list[str]]

    def rows(self) -> Iterator[list[Any]]:
        """Row after row as plain numbers; None where there is no measurement."""
        columns = [_plain(name, values) for name, values in self.columns.items()]
        return (list(row) for row in zip(*columns, strict=True))


def trace(cell: Cell, seed: int, run: int, label: str) -> Trace:
    """Run number `run` of a cell as the filter `label` goes through it, with the numbers of the study.

    UsageError for a smoother of one point, whose estimates are not along the run, and beyond the last recording.
    """
    filter_of(cell, label)
    experiment = Experiment.of(cell.spec)
    recording = experiment.recording
    if recording is not None and run >= recording.runs:
        raise UsageError(f"run {run}: the data has {recording.runs} recordings, so --run is 0 to {recording.runs - 1}")
    streams = Streams(seed, run // GROUP)
    world = experiment.simulate(streams)
    filt = experiment.filters[label][0]
    if getattr(filt, "target", None) is not None:
        raise UsageError(f"'{label}' estimates one step only: trace the filter inside it")
    keep = frozenset(getattr(filt, "sees", frozenset())) | {"cov"}
    estimate = alone(experiment, world, streams, label, keep - HIDDEN)
    model = experiment.model
    columns, shown = _columns(experiment, world, estimate, run)
    return Trace(cell.case, label, run, columns, tuple(model.states), tuple(model.measurements), shown)


def worst(scenario: Scenario, cell: Cell, label: str, metric: str, folder: Path) -> tuple[int, float]:
    """The run of the study in which a metric of the filter is largest, or smallest where large is good, and its value
    there; a failed run is the worst.

    Taken from the results `folder` as far as its numbers are those of this scenario and code, else computed.
    """
    check(metric, cell, tuning=False)
    values = _stored(scenario, cell, label, metric, folder)
    if values is None:
        score = Bench(cell.spec, filter_of(cell, label), metric, scenario.seed, scenario.runs)([{}])[0]
        values = np.where(score.failed, np.inf, score.values)
    if np.isnan(values).all():
        raise UsageError(f"the metric '{metric}' is not defined in any run of '{label}'")
    good = metrics.get(metric).better == "large"
    run = int(np.nanargmax(np.where(np.isposinf(values), values, -values) if good else values))
    return run, float(values[run])


def _stored(scenario: Scenario, cell: Cell, label: str, metric: str, folder: Path) -> Array | None:
    """The metric by run from the finished blocks of a results folder; None unless all are there and up to date."""
    found = []
    for unit in plan.units(replace(scenario, cells=(cell,), sensitivity=()), folder, full=True):
        if label not in plan.look_up(unit).usable:
            return None
        part = blocks.read(unit.path, {label})[label]
        if metric not in part.values:
            return None
        found.append(np.where(part.failed, np.inf, part.values[metric]))
    return np.concatenate(found)


def _columns(
    experiment: Experiment, world: World, estimate: Estimate, run: int
) -> tuple[dict[str, Array], dict[str, list[str]]]:
    """The columns of a run, given its group of runs, and which of them are what the filter shows."""
    model, T, i = experiment.model, len(world.y), run % GROUP
    states, measurements = tuple(model.states), tuple(model.measurements)
    columns: dict[str, Array] = {"k": np.arange(1, T + 1)}
    if experiment.recording is not None and experiment.recording.times is not None:
        columns["t"] = experiment.recording.times[:, run]
    elif (dt := getattr(model, "dt", None)) is not None:
        columns["t"] = dt * columns["k"]

    def add(prefix: str, names: Sequence[str], values: Array) -> list[str]:
        new = {f"{prefix}_{name}" if name else prefix: values[:, j] for j, name in enumerate(names)}
        columns.update(new)
        return list(new)

    if not np.isnan(x := _of(world.x, i)).all():
        add("x", states, x)
    add("y", measurements, _of(world.y, i))
    add("xhat", states, _of(estimate.mean, i))
    if estimate.cov is not None:
        P = _of(estimate.cov, i)
        add("sd", states, np.sqrt(np.einsum("tii->ti", P)))
    shown = {}
    for name, history in sorted(estimate.extras.items(), key=lambda item: (item[0] not in ("nu", "S"), item[0] == "S")):
        values = _of(history, i)
        if values.ndim == 3 and name == "S":
            pairs = [(a, b) for a in range(len(measurements)) for b in range(a, len(measurements))]
            upper = [f"{measurements[a]}_{measurements[b]}" for a, b in pairs]
            add("S", upper, np.stack([values[:, a, b] for a, b in pairs], axis=1))
        elif values.ndim == 2:
            listed = add(name, components(name, values.shape[1], model), values)
            if name != "nu":
                shown[name] = listed
    for prefix, flags, names in (("outlier", world.v.flags, measurements), ("process_outlier", world.w.flags, states)):
        if flags is not None:
            of_run = np.asarray(flags[..., i]).reshape(T, -1)
            add(prefix, names if of_run.shape[1] == len(names) > 1 else [""], of_run.astype(int))
    columns["failed"] = (~np.isfinite(_of(estimate.mean, i)).all(1)).astype(int)
    return columns, shown


def _of(A: Array, i: int) -> Array:
    """Run i of an array whose last axis are the runs, or one value for all of them."""
    return A[..., i if A.shape[-1] > 1 else 0]


def _plain(name: str, values: Array) -> list[Any]:
    numbers = values.tolist()
    return [None if each != each else each for each in numbers] if name.startswith(("y_", "nu_", "S_")) else numbers
