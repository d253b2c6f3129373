"""Wide batches: the runs of several cases side by side through one filter, as if they were one block.

At 100 runs a step costs its Python calls, not its arithmetic, so four cases together cost little more than one. What a
filter gives for a run depends on that run alone, to the last bit, as long as a batch is made of whole eights: nothing
else changes, and of the groups of 128 runs that are drawn only those wanted go in. Only what is known to keep this goes
wide; the rest is run case by case, on whole groups.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, NamedTuple

import numpy as np

from rkfbench.experiment import Experiment, World
from rkfbench.filters import Estimate
from rkfbench.filters.baselines import BayesGrid
from rkfbench.filters.estimates import Estimates
from rkfbench.filters.flow import Flow
from rkfbench.filters.particle import ParticleFilter, ParticleSmoother
from rkfbench.filters.references import Clairvoyant, Rejecting, Truth
from rkfbench.linalg import Array
from rkfbench.streams import Streams

# What cells that are computed together may differ in: all that is about the truth and not about the filters.
OF_THE_TRUTH = ("truth", "start", "process_noise", "measurement_noise", "disturbances", "lost")

# They look at more than the measurements, or take the cases one by one anyhow.
APART = (Clairvoyant, Rejecting, Truth, BayesGrid, Flow, Estimates)


class Case(NamedTuple):
    """One of the cells that are computed together, and what happened in its runs."""

    experiment: Experiment
    world: World


def structure(spec: Mapping[str, Any]) -> dict[str, Any]:
    """What cells must have in common to be computed together."""
    return {key: value for key, value in spec.items() if key not in OF_THE_TRUTH}


def worlds(experiments: Sequence[Experiment], streams: Streams) -> list[Case]:
    """What happens in every case; the cases have the same `structure`."""
    first = experiments[0]
    recorded_or_scripted = any(each.recording is not None or each.script is not None for each in experiments)
    if len(experiments) == 1 or recorded_or_scripted or not goes_wide(first.model):
        return [Case(each, each.simulate(streams)) for each in experiments]
    drawn = [each.drawn(streams) for each in experiments]
    starts, own_starts, w, v = zip(*drawn, strict=True)
    x, y = first.follow(_joined(starts), _joined([each.value for each in w]), _joined([each.value for each in v]))
    own_x, own_y = (map(np.ascontiguousarray, np.split(A, len(drawn), axis=-1)) for A in (x, y))
    divided = zip(own_x, own_y, own_starts, w, v, strict=True)
    return [Case(each, World(*parts)) for each, parts in zip(experiments, divided, strict=True)]


def estimates(
    cases: Sequence[Case], streams: Streams, label: str, keep: Collection[str], runs: int | None = None
) -> list[Estimate]:
    """The estimates of one filter in every case, for the first `runs` runs, whole eights of them; the cases have the
    same `structure`.
    """
    found: dict[int, Estimate] = {}
    wanted = slice(runs)
    for batch in _batches(cases, label):
        together = [cases[i] for i in batch]
        if _may_be_cut(together[0], label):
            together = [case._replace(world=case.world.of(wanted)) for case in together]
        if len(batch) == 1:
            found[batch[0]] = alone(*together[0], streams, label, keep)
        else:
            found |= zip(batch, _side_by_side(together, streams, label, keep), strict=True)
    return [found[i].of(wanted) for i in range(len(cases))]


def alone(experiment: Experiment, world: World, streams: Streams, label: str, keep: Collection[str]) -> Estimate:
    """The estimates of one filter in one case."""
    filt, told = experiment.filters[label]
    return filt.run(
        experiment.assumed_model,
        world.y,
        world.x0 if _starts_there(experiment, label) else told.mean,
        told.P0,
        Q=told.Q,
        R=told.R,
        keep=keep,
        known=world.known,
        streams=streams.within("filter"),
    )


def apart(experiment: Experiment, labels: Collection[str]) -> bool:
    """Whether none of these filters takes cases side by side: then a job of several cases saves nothing."""
    return not any(goes_wide(experiment.filters[label][0]) for label in labels)


def goes_wide(part: Any) -> bool:
    """Whether a filter, a model, or a piece of one is made of parts of this package alone, none of them `APART`.

    What others wrote may well depend on the width of a batch in the last bit.
    """
    if part is None or isinstance(part, (str, int, float)) or (isinstance(part, np.ndarray) and part.dtype != object):
        return True
    if isinstance(part, (tuple, frozenset)):
        return all(map(goes_wide, part))
    own = is_dataclass(part) and type(part).__module__.partition(".")[0] == __name__.partition(".")[0]
    return own and not isinstance(part, APART) and all(goes_wide(getattr(part, each.name)) for each in fields(part))


def _may_be_cut(case: Case, label: str) -> bool:
    """Whether a filter may leave runs out of the groups that were drawn: not if it draws itself, run beside run."""
    filt = case.experiment.filters[label][0]
    complete = not np.isnan(case.world.y).any()
    return complete and goes_wide(filt) and goes_wide(case.experiment.assumed_model) and not _draws(filt)


def _draws(part: Any) -> bool:
    """Whether a filter, or one inside it, draws random numbers."""
    inside = (getattr(part, each.name) for each in fields(part)) if is_dataclass(part) else ()
    return isinstance(part, (ParticleFilter, ParticleSmoother)) or any(map(_draws, inside))


def _batches(cases: Sequence[Case], label: str) -> list[list[int]]:
    """Which cases go through the filter together, by their places."""
    first = cases[0].experiment
    if len(cases) == 1 or not (goes_wide(first.filters[label][0]) and goes_wide(first.assumed_model)):
        return [[i] for i in range(len(cases))]
    batches: list[list[int]] = []
    for i, case in enumerate(cases):
        # with missing components runs are sorted by what they miss, and those portions have any width
        fits = not np.isnan(case.world.y).any()
        home = next((batch for batch in batches if fits and _told_the_same(cases[batch[0]], case, label)), None)
        if home is None:
            batches.append([i])
        else:
            home.append(i)
    return batches


def _told_the_same(one: Case, other: Case, label: str) -> bool:
    if np.isnan(one.world.y).any() or one.world.y.shape != other.world.y.shape:
        return False
    a, b = one.experiment.filters[label][1], other.experiment.filters[label][1]
    alike = all(np.array_equal(getattr(a, name), getattr(b, name)) for name in ("mean", "P0", "Q", "R"))
    alike = alike and equal(one.experiment.filters[label][0], other.experiment.filters[label][0])
    return alike and _starts_there(one.experiment, label) == _starts_there(other.experiment, label)


def equal(one: Any, other: Any) -> bool:
    """Whether two filters that go wide, or pieces of them, are the same; they may have been told different laws."""
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return np.array_equal(one, other)
    if is_dataclass(one) and type(one) is type(other):
        return all(equal(getattr(one, each.name), getattr(other, each.name)) for each in fields(one))
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(equal, one, other))
    return bool(one == other)


def _starts_there(experiment: Experiment, label: str) -> bool:
    """Whether the filter starts at the mean that all filters are told, which may be drawn for each run."""
    told = experiment.filters[label][1]
    return told.mean is experiment.told.mean or np.array_equal(told.mean, experiment.told.mean)


def _side_by_side(cases: Sequence[Case], streams: Streams, label: str, keep: Collection[str]) -> list[Estimate]:
    """One batch of all runs, divided into the cases again."""
    experiment = cases[0].experiment
    filt, told = experiment.filters[label]
    y = _joined([case.world.y for case in cases])
    x0 = _joined([case.world.x0 for case in cases]) if _starts_there(experiment, label) else told.mean
    whole = filt.run(
        experiment.assumed_model,
        y,
        x0,
        told.P0,
        Q=told.Q,
        R=told.R,
        keep=keep,
        streams=streams.within("filter"),
    )
    width = y.shape[-1] // len(cases)
    return [whole.of(slice(i * width, (i + 1) * width)) for i in range(len(cases))]


def _joined(arrays: Sequence[Array]) -> Array:
    return np.concatenate(arrays, axis=-1)
