"""Compute one block of one cell: simulate it once, run each filter on it, reduce the estimates to metrics.

A pure function of plain data. Whole groups of 128 runs are computed and cut to the runs wanted, so no number depends
on how many those are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench import metrics
from rkfbench.experiment import Experiment, World
from rkfbench.filters import Estimate
from rkfbench.linalg import Array
from rkfbench.metrics import Metric, Trial
from rkfbench.own.filters import OneByOne
from rkfbench.streams import GROUP, Streams
from rkfbench.study.blocks import block_size


@dataclass(frozen=True)
class FilterResult:
    """One filter on one block: which runs failed and were lost (M,), values by metric (M,), curves by metric (K, M)."""

    failed: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    values: Mapping[str, Array]
    curves: Mapping[str, Array]


@dataclass(frozen=True)
class BlockResult:
    """The filters of one block, which holds the runs first .. last - 1."""

    first: int
    last: int
    filters: Mapping[str, FilterResult]


def compute(spec: Mapping[str, Any], seed: int, block: int, runs: int, labels: Sequence[str]) -> BlockResult:
    """Filters `labels` on block number `block` of a study of `runs` runs of the cell that `spec` describes."""
    experiment = Experiment.of(spec)
    size = block_size(experiment.steps)
    first, last = block * size, min((block + 1) * size, runs)
    streams = Streams(seed, first // GROUP, -(-(last - first) // GROUP))
    world = experiment.simulate(streams)
    partners = _partners(experiment, labels)
    experiment = _narrowed(experiment, last - first)
    held = {label: _estimate(experiment, world, streams, label, keep) for label, keep in partners.items()}
    hosts = _hosts(experiment, [label for label in labels if label not in held])
    passed: dict[str, Estimate | None] = {}
    results = {}
    for label in sorted(labels, key=lambda label: label in hosts):  # a filter after the smoother that runs it anyhow
        wanted = _wanted(experiment, label)
        keep = _keep(wanted) | (frozenset({"passed"}) if label in hosts.values() else frozenset())
        estimate = (
            held.get(label) or passed.get(hosts.get(label, "")) or _estimate(experiment, world, streams, label, keep)
        )
        passed[label] = estimate.passed
        results[label] = _reduce(experiment, world, label, estimate, wanted, held, last - first)
    return BlockResult(first, last, {label: results[label] for label in labels})


def _narrowed(experiment: Experiment, runs: int) -> Experiment:
    """The experiment whose filters that take the runs one by one leave out those that nobody wants."""
    filters = {
        label: (filt.first(runs) if isinstance(filt, OneByOne) else filt, told)
        for label, (filt, told) in experiment.filters.items()
    }
    return replace(experiment, filters=filters)


def _hosts(experiment: Experiment, labels: Sequence[str]) -> dict[str, str]:
    """For the filters that a smoother among the others runs on its way, with the same numbers: the label of that
    smoother.
    """
    found = {}
    for host in labels:
        smoother, told = experiment.filters[host]
        inner = smoother.passes(experiment.steps) if hasattr(smoother, "passes") else None
        for label in labels if inner is not None else ():
            if (
                experiment.filters[label][0] == inner
                and experiment.filters[label][1] is told
                and _keep(_wanted(experiment, label)) <= {"prior_mean"}
            ):
                found[label] = host
    return found


def _wanted(experiment: Experiment, label: str) -> list[Metric]:
    """The metrics that apply to a filter."""
    return [metric for metric in experiment.metrics if metrics.applies(metric, experiment.filters[label][0])]


def _keep(wanted: Sequence[Metric]) -> frozenset[str]:
    return frozenset().union(*(metric.quantity.keep for metric in wanted))


def _partners(experiment: Experiment, labels: Sequence[str]) -> dict[str, frozenset[str]]:
    """The filters that metrics of the wanted ones compare with, each with all histories that are needed of it."""
    needed: dict[str, frozenset[str]] = {}
    for label in labels:
        for metric in _wanted(experiment, label):
            for partner, keep in metric.quantity.partners.items():
                own = _keep(_wanted(experiment, partner)) if partner in labels else frozenset()
                needed[partner] = needed.get(partner, own) | keep
    return needed


def _estimate(experiment: Experiment, world: World, streams: Streams, label: str, keep: frozenset[str]) -> Estimate:
    filt, told = experiment.filters[label]
    x0 = world.x0 if told.mean is experiment.told.mean or np.array_equal(told.mean, experiment.told.mean) else told.mean
    return filt.run(
        experiment.assumed_model,
        world.y,
        x0,
        told.P0,
        Q=told.Q,
        R=told.R,
        keep=keep,
        known=world.known,
        streams=streams.within("filter"),
    )


def _reduce(
    experiment: Experiment,
    world: World,
    label: str,
    estimate: Estimate,
    wanted: Sequence[Metric],
    held: Mapping[str, Estimate],
    runs: int,
) -> FilterResult:
    trial = Trial(experiment, world, experiment.filters[label][0], estimate, held)
    lost = np.zeros(len(estimate.failed), dtype=bool)
    if experiment.lost is not None:
        with np.errstate(all="ignore"):  # a smoother of one point is lost where its filter is, at that point
            lost = experiment.lost(estimate.extras.get("post_mean", estimate.mean) - trial.truth())
    without = {metric: estimate.failed | lost if metric.tracking else estimate.failed for metric in wanted}
    numbers = {metric: np.where(without[metric], np.nan, metric(trial))[..., :runs] for metric in wanted}
    return FilterResult(
        estimate.failed[:runs],
        lost[:runs],
        {metric.name: value for metric, value in numbers.items() if not metric.curve},
        {metric.name: value for metric, value in numbers.items() if metric.curve},
    )
