"""Computing times: each filter alone on simulated data, repeats interleaved between the filters, one BLAS thread.

Two forms. `time_ms`: one run by itself, ms per run of T steps, comparable with what papers print. `time_ns`: a batch
of 128 runs, ns per run and step. Only the filter is timed: no random numbers, no metrics, no histories. A full study
times whole runs by themselves. Else some steps are timed and scaled to all, unless late ones are known to cost less;
what a call costs once then counts too much, by 1 or 2 %, for particles by 20 %. Clock values are never byte-compared
and decide no exit code.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rkfbench.experiment import Experiment, World
from rkfbench.linalg import Array
from rkfbench.streams import Streams
from rkfbench.times import FORMS

REPEATS = 10
SECONDS = 0.005  # of one measurement of some steps, about
LEAST = 5  # steps, however long they take


@dataclass(frozen=True)
class Time:
    """One measurement; metric is time_ms or time_ns."""

    filter: str
    metric: str
    value: float


def measure(spec: Mapping[str, Any], seed: int, labels: Sequence[str], *, full: bool = False) -> Iterator[Time]:
    """Times of the filters `labels` in the case that `spec` describes, in both forms if `full`; two rounds come before
    those that count: one warms up, one tells how many steps take long enough to be measured.
    """
    experiment = Experiment.of(spec)
    world = experiment.simulate(Streams(seed))
    T = experiment.steps
    runs_of = {"time_ms": slice(0, 1), "time_ns": slice(None)}
    scale_of = {"time_ms": T * 1e3, "time_ns": 1e9 / world.y.shape[2]}
    steps_of: dict[tuple[str, str], int] = {}
    for repeat in range(-2, REPEATS):
        for metric in FORMS if full else FORMS[:1]:
            for label in labels:
                fixed = at_one_point(experiment, label)
                steps = steps_of.get((metric, label), T if fixed else min(T, LEAST))
                step = seconds(experiment, world, label, runs_of[metric], steps) / steps
                if repeat < 0:
                    whole = fixed or settles(experiment, label) or (full and metric == "time_ms")
                    steps_of[metric, label] = T if whole else min(T, max(LEAST, int(SECONDS / step)))
                else:
                    yield Time(label, metric, step * scale_of[metric])


def settles(experiment: Experiment, label: str) -> bool:
    """Whether the late steps of a filter, or of the one in a smoother, may cost less than its first ones."""
    filt: Any = experiment.filters[label][0]
    return bool(getattr(getattr(filt, "filter", filt), "settles", False))


def at_one_point(experiment: Experiment, label: str) -> bool:
    """Whether a filter estimates one step that cannot be moved, as it stands inside another one."""
    filt: Any = experiment.filters[label][0]
    return getattr(filt, "target", None) is not None and not hasattr(filt, "at")


def seconds(experiment: Experiment, world: World, label: str, runs: slice, steps: int) -> float:
    """The time that a filter takes for some of the runs and the first steps; a smoother makes the estimates of the
    filter that it runs, too.
    """
    filt: Any
    filt, told = experiment.filters[label]
    keep = ("passed",) if hasattr(filt, "passes") else ()
    if getattr(filt, "at", None) is not None:  # a smoother of one point: the same share of the steps around it
        share = steps / experiment.steps
        at = max(1, round(filt.at * share))
        filt = replace(filt, at=at, lag=max(0, round((filt.at + filt.lag) * share) - at))

    def cut(A: Array) -> Array:
        return A[:steps] if A.ndim == 4 else A

    y, x0 = world.y[:steps, :, runs], world.x0[:, runs]
    begin = time.perf_counter()
    filt.run(
        experiment.assumed_model,
        y,
        x0,
        told.P0,
        Q=cut(told.Q),
        R=cut(told.R),
        keep=keep,
        known=world.known.of(runs, steps),
        streams=Streams(0),
    )
    return time.perf_counter() - begin
