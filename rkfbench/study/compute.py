"""Compute one block of one cell: simulate it once, run each filter on it, reduce the estimates to metrics.

A pure function of plain data. Whole groups of 128 runs are drawn, and filters take whole eights of runs of them, so no
number depends on how many are wanted.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench import metrics
from rkfbench.experiment import Experiment
from rkfbench.filters import Estimate
from rkfbench.filters.particle import ParticleFilter, ParticleSmoother
from rkfbench.linalg import LANES, Array
from rkfbench.metrics import Metric, Trial
from rkfbench.own.onerun import OneByOne
from rkfbench.streams import GROUP, Remembered, Streams
from rkfbench.study.blocks import block_size
from rkfbench.study.wide import Case, estimates, worlds

PORTIONED = (OneByOne, ParticleFilter, ParticleSmoother)  # they take a few runs at a time, and can leave out the last


@dataclass(frozen=True)
class FilterResult:
    """One filter on one block: which runs failed and were lost (M,), values by metric (M,), curves by metric (K, M),
    and how the first of the failed runs died, where that is known.
    """

    failed: NDArray[np.bool_]
    lost: NDArray[np.bool_]
    values: Mapping[str, Array]
    curves: Mapping[str, Array]
    death: str = ""


@dataclass(frozen=True)
class BlockResult:
    """The filters of one block."""

    filters: Mapping[str, FilterResult]


def compute(spec: Mapping[str, Any], seed: int, block: int, runs: int, labels: Sequence[str]) -> BlockResult:
    """Filters `labels` on block number `block` of a study of `runs` runs of the cell that `spec` describes."""
    results = {label: result for label, (result,) in together([spec], seed, block, runs, labels)}
    return BlockResult({label: results[label] for label in labels})


def together(
    specs: Sequence[Mapping[str, Any]], seed: int, block: int, runs: int, labels: Sequence[str]
) -> Iterator[tuple[str, list[FilterResult]]]:
    """The same for several cells that have `wide.structure` in common: filter after filter its result in every cell.

    The cells share what is drawn, and go through a filter as one batch where that changes no bit.
    """
    first, last = _runs_of(specs[0]["steps"], block, runs)
    experiments = [_narrowed(Experiment.of(spec), last - first) for spec in specs]
    experiment = experiments[0]
    groups = first // GROUP, -(-(last - first) // GROUP)
    streams = Streams(seed, *groups) if len(specs) == 1 else Remembered(seed, *groups)
    cases = worlds(experiments, streams)
    width = -(-(last - first) // LANES) * LANES
    seen = [case._replace(world=case.world.of(slice(width))) for case in cases]
    partners = _partners(experiment, labels)
    held = {label: estimates(cases, streams, label, keep, width) for label, keep in partners.items()}
    hosts = _hosts(experiment, [label for label in labels if label not in held])
    passed: dict[str, list[Estimate | None]] = {}
    for label in sorted(labels, key=lambda label: label in hosts):  # a filter after the smoother that runs it anyhow
        found: Sequence[Estimate | None] | None = held.get(label) or passed.get(hosts.get(label, ""))
        if found is None:
            keep = _keep(_wanted(experiment, label)) | ({"passed"} if label in hosts.values() else frozenset())
            found = estimates(cases, streams, label, keep, width)
        results = []
        for i, (case, estimate) in enumerate(zip(seen, found, strict=True)):
            assert estimate is not None  # a host keeps what passes through it
            others = {partner: of_cases[i] for partner, of_cases in held.items()}
            results.append(_reduce(case, label, estimate, others, last - first))
        passed[label] = [None if each is None else each.passed for each in found]
        yield label, results


def _narrowed(experiment: Experiment, runs: int) -> Experiment:
    """The experiment whose filters that take the runs in small portions leave out those that nobody wants."""
    filters = {
        label: (filt.first(runs) if isinstance(filt, PORTIONED) else filt, told)
        for label, (filt, told) in experiment.filters.items()
    }
    return replace(experiment, filters=filters)


def portioned(experiment: Experiment, labels: Sequence[str]) -> bool:
    """Whether one of these filters takes a few runs at a time: then it costs as much for each run in any batch."""
    return any(isinstance(experiment.filters[label][0], PORTIONED) for label in labels)


def sharing(experiment: Experiment, labels: Sequence[str], partners: bool = True) -> list[tuple[str, ...]]:
    """The filters `labels` in groups that share work: a smoother with the filter that it runs on its way and, with
    `partners`, filters with those that their metrics compare them with.
    """
    compared = _partners(experiment, labels)
    pairs = list(_hosts(experiment, [label for label in labels if label not in compared]).items())
    if partners:
        pairs += [
            (label, partner)
            for label in labels
            for metric in _wanted(experiment, label)
            for partner in metric.quantity.partners
            if partner in labels
        ]
    group = {label: {label} for label in labels}
    for one, other in pairs:
        merged = group[one] | group[other]
        group |= dict.fromkeys(merged, merged)
    return list(dict.fromkeys(tuple(each for each in labels if each in group[label]) for label in labels))


def _runs_of(steps: int, block: int, runs: int) -> tuple[int, int]:
    """The first run of a block, and the one behind its last."""
    size = block_size(steps)
    return block * size, min((block + 1) * size, runs)


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


def _reduce(case: Case, label: str, estimate: Estimate, others: Mapping[str, Estimate], runs: int) -> FilterResult:
    experiment, world = case
    wanted = _wanted(experiment, label)
    filt, told = experiment.filters[label]
    trial = Trial(experiment, world, filt, estimate, others, told)
    lost = np.zeros(len(estimate.failed), dtype=bool)
    if experiment.lost is not None:
        with np.errstate(all="ignore"):  # a smoother of one point is lost where its filter is, at that point
            lost = experiment.lost(estimate.extras.get("post_mean", estimate.mean) - trial.truth())
    without = {metric: estimate.failed | lost if metric.tracking else estimate.failed for metric in wanted}
    values = {metric: np.where(metric.kept & lost, 0.0, metric(trial)) for metric in wanted}
    numbers = {metric: np.where(without[metric], np.nan, value)[..., :runs] for metric, value in values.items()}
    return FilterResult(
        estimate.failed[:runs],
        lost[:runs],
        {metric.name: value for metric, value in numbers.items() if not metric.curve},
        {metric.name: value for metric, value in numbers.items() if metric.curve},
        estimate.death,
    )
