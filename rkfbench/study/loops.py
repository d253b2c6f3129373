"""What it costs that a filter is looped over the runs one by one: measured on a few steps before a study begins."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING

from rkfbench.errors import RkfbenchError
from rkfbench.study.events import Looped

if TYPE_CHECKING:
    from rkfbench.study.plan import Stored, Unit

STEPS = 20  # that are timed
REPEATS = 3


def notes(wanted: Sequence[tuple[Unit, Stored]]) -> Iterator[Looped]:
    """For each looped filter of the work that is to be done: its time a run and step, beside that of a Kalman filter of
    the catalogue on a batch of runs.
    """
    told: set[str] = set()
    for unit, was in wanted:
        labels = [label for label in was.missing if label not in told]
        if "plugins" not in unit.cell.spec or not labels:
            continue
        told |= set(labels)
        for label, loop, batch in _times(unit, labels):
            steps = sum(
                each.cell.spec["steps"] * (each.last - each.first) for each, of in wanted if label in of.missing
            )
            yield Looped(label, loop * 1e6, loop / batch, loop * steps)


def _times(unit: Unit, labels: Sequence[str]) -> Iterator[tuple[str, float, float]]:
    """Label, and seconds a run and step of the filter and of a batch filter."""
    from rkfbench.experiment import Experiment
    from rkfbench.filters import build
    from rkfbench.own.onerun import OneByOne
    from rkfbench.streams import Streams
    from rkfbench.study.timing import seconds

    experiment = Experiment.of(unit.cell.spec)
    loops = [label for label in labels if isinstance(experiment.filters[label][0], OneByOne)]
    if not loops:
        return
    model = experiment.model
    batch = build("kf" if model.linear else "ekf" if hasattr(model, "F") and hasattr(model, "H") else "ckf")
    experiment = replace(experiment, filters={**experiment.filters, "": (batch, experiment.told)})
    steps = min(experiment.steps, STEPS)

    def least(label: str, M: int) -> float:
        return min(seconds(experiment, world, label, slice(0, M), steps) for _ in range(REPEATS)) / M / steps

    try:
        world = experiment.simulate(Streams(0))
        reference = least("", world.y.shape[2])
    except Exception:  # of a plug-in's law or model: told when the work is done
        return
    for label in loops:
        with suppress(RkfbenchError):  # told when its work is done
            yield label, least(label, 1), reference
