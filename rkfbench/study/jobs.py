"""One piece of work of a study: some filters on one block of runs of one case, from plain data to small arrays.

A job travels to another process or machine as it is, and what comes back is small: numbers per run, and curves already
reduced to their moments. A filter that raises takes no other filter with it.
"""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from rkfbench.own.faults import told
from rkfbench.store.blocks import Array, Curve, Part


@dataclass(frozen=True)
class Job:
    """Filters `labels` on block `block` of the `runs` runs of the case that `spec` describes (plain data)."""

    index: int
    spec: Mapping[str, Any]
    seed: int
    block: int
    runs: int
    labels: tuple[str, ...]


@dataclass(frozen=True)
class Fault:
    """An exception of one filter: what the user reads, and the traceback behind it."""

    message: str
    traceback: str


@dataclass(frozen=True)
class Done:
    """What became of a job: for each label a part or a fault."""

    index: int
    parts: Mapping[str, Part]
    faults: Mapping[str, Fault]


def work(job: Job) -> Done:
    """Compute a job. When it raises, its filters are taken one by one, to keep those that do work."""
    try:
        return Done(job.index, _compute(job, job.labels), {})
    except Exception as error:
        if len(job.labels) == 1:
            fault = Fault(told(error), traceback.format_exc())
            return Done(job.index, {}, {job.labels[0]: fault})
    parts: dict[str, Part] = {}
    faults: dict[str, Fault] = {}
    for label in job.labels:
        single = work(Job(job.index, job.spec, job.seed, job.block, job.runs, (label,)))
        parts |= single.parts
        faults |= single.faults
    return Done(job.index, parts, faults)


def _compute(job: Job, labels: tuple[str, ...]) -> dict[str, Part]:
    from rkfbench import metrics
    from rkfbench.study.compute import compute

    def curve(metric: str, paths: Array, failed: Array) -> Curve:
        return Curve.of(metrics.get(metric).ks(job.spec["steps"])[: len(paths)], paths, failed)

    result = compute(dict(job.spec), job.seed, job.block, job.runs, labels)
    return {
        label: Part(
            each.failed,
            each.lost,
            each.values,
            {metric: curve(metric, paths, each.failed) for metric, paths in each.curves.items()},
        )
        for label, each in result.filters.items()
    }
