"""The best setting of a filter, chosen on tuning runs and reported on the test runs, beside the setting it had.

    chosen = best mean of a metric over the tuning runs, of all settings            (a seed of their own)
    report: mean over the test runs (the study's own seed) of both settings, and of their paired difference

All settings see the same tuning runs (common random numbers), so the mean is a smooth function of a parameter and an
optimiser can follow it: a grid first, then in the gap around its best point Brent's bounded method for one parameter,
the Nelder-Mead simplex within bounds for several. The best mean is the smallest, or the largest of a metric that says
so (`log_likelihood`). A setting with fewer failed runs is the better one, whatever its mean.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench import metrics
from rkfbench.errors import RkfbenchError, SpecError, UsageError
from rkfbench.linalg import Array
from rkfbench.metrics import consistency
from rkfbench.metrics.base import Better
from rkfbench.study.axes import Axis, Setting, changed, current
from rkfbench.study.blocks import block_size
from rkfbench.study.summary import summarise
from rkfbench.study.tuning import SEED_STEP

if TYPE_CHECKING:
    from rkfbench.scenario import Cell

POINTS = {1: 13, 2: 7}  # of the grid along each parameter, by the number of parameters; 5 for more
MOST_SETTINGS = 2000
TOLERANCE = 1e-3  # of the bounded method, in shares of the range searched
MOST_STEPS = {1: 20, 2: 60}  # settings that the optimiser tries, for one parameter and for more


@dataclass(frozen=True)
class Score:
    """A metric of one setting by run: values (M,), NaN where the run failed."""

    values: Array
    failed: Array
    root: bool
    better: Better = "small"

    @property
    def row(self) -> dict[str, Any]:
        """runs, failed, mean, se, sd and quantiles."""
        counts = {"runs": len(self.failed), "failed": int(self.failed.sum())}
        return counts | summarise(self.values, self.failed, self.root)

    @property
    def rank(self) -> tuple[int, float]:
        """What is to be small."""
        mean = self.row["mean"]
        if mean is None or math.isnan(mean):
            return int(self.failed.sum()), math.inf
        return int(self.failed.sum()), -mean if self.better == "large" else mean


@dataclass(frozen=True)
class Tuned:
    """What was chosen for one cell: parameters before and after, the curves of the tuning runs (path -> value and
    score), the test runs under both settings, and how many settings were tried.
    """

    cell: Cell
    before: Setting
    chosen: Setting
    curves: Mapping[str, list[tuple[Any, Score]]]
    test_before: Score
    test_chosen: Score
    tried: int

    @property
    def difference(self) -> tuple[float | None, float | None]:
        """Chosen minus before on the test runs in which neither failed: mean and standard error of the paired
        difference. There is none of a root over the runs.
        """
        if self.test_before.root:
            return None, None
        there = ~(self.test_before.failed | self.test_chosen.failed)
        row = summarise((self.test_chosen.values - self.test_before.values)[there], np.zeros(int(there.sum()), bool))
        return row["mean"], row["se"]

    def at_the_end(self, axes: Sequence[Axis]) -> list[str]:
        """The parameters whose best value is an end of their range: a better one may lie beyond."""
        ends = {axis.path: (axis.values[0], axis.values[-1]) for axis in axes if axis.continuous}
        return [path for path, pair in ends.items() if any(math.isclose(self.chosen[path], end) for end in pair)]


@dataclass
class Bench:
    """Runs settings of one filter in one cell and remembers their scores."""

    spec: Mapping[str, Any]
    filter: Mapping[str, Any]
    metric: str
    seed: int
    runs: int
    better: Better = "small"
    scores: dict[str, Score] = field(default_factory=dict)

    def __call__(self, settings: Sequence[Setting]) -> list[Score]:
        """The scores of the settings, which all see the same runs."""
        new = {str(setting): setting for setting in settings if str(setting) not in self.scores}
        if new:
            self.scores |= dict(zip(new, self._compute(list(new.values())), strict=True))
        return [self.scores[str(setting)] for setting in settings]

    def _compute(self, settings: Sequence[Setting]) -> list[Score]:
        from rkfbench.study import compute

        labels = [str(i) for i in range(len(settings))]
        described = [
            {**changed(self.filter, setting), "label": label} for label, setting in zip(labels, settings, strict=True)
        ]
        spec = {**self.spec, "filters": described, "metrics": [self.metric]}
        blocks = range(-(-self.runs // block_size(spec["steps"])))
        results = [compute.compute(spec, self.seed, block, self.runs, labels).filters for block in blocks]
        if any(self.metric not in result[labels[0]].values for result in results):
            raise UsageError(f"the metric '{self.metric}' does not apply to the filter '{self.filter['label']}'")
        root = metrics.get(self.metric).root
        return [
            Score(
                np.concatenate([result[label].values[self.metric] for result in results]),
                np.concatenate([result[label].failed for result in results]),
                root,
                self.better,
            )
            for label in labels
        ]


def check(metric: str, cell: Cell, tuning: bool = True) -> None:
    """UsageError unless the metric is one number a run of one filter, and there are runs to tune on."""
    try:
        found = metrics.get(metric)
    except SpecError as error:
        raise UsageError(f"--metric: {error}") from None
    if found.curve or found.quantity.partners:
        raise UsageError(f"--metric: '{metric}' is not one number a run of the filter alone")
    if tuning and cell.spec.get("data"):
        raise UsageError("tune needs runs of their own to choose on, and recorded data has none: tune on a simulation")


def better(metric: str, cell: Cell) -> Better:
    """Whether a small or a large mean of the metric is what tuning looks for; UsageError where it is neither.

    `score` is what the scenario means by it.
    """
    found = metrics.get(metric)
    if isinstance(found.quantity, consistency.Score):
        found = metrics.get(cell.spec.get("score") or "rmse")
    if found.better is not None:
        return found.better
    if re.split(r"[(\[@]", found.name)[0] not in metrics.METRICS:
        raise UsageError(f'--metric: \'{metric}\' does not say what is better: give it `better = "small"` or "large"')
    raise UsageError(
        f"--metric: neither a small nor a large '{metric}' makes a filter better: "
        "tune on an error such as rmse, or on log_likelihood"
    )


def tune(
    cell: Cell, spec: Mapping[str, Any], axes: Sequence[Axis], metric: str, *, seed: int, runs: int, refine: bool = True
) -> Tuned:
    """Choose the parameters `axes` of the filter that `spec` describes on tuning runs, and try the choice on the test
    runs, those of `seed`.

    Raises UsageError where every setting has failed runs only or the metric is not about this filter.
    """
    check(metric, cell)
    wanted = better(metric, cell)
    tuning = Bench(cell.spec, spec, metric, seed + SEED_STEP, runs, wanted)
    paths = [each.path for each in axes]
    if (count := math.prod(len(each.values) for each in axes)) > MOST_SETTINGS:
        raise UsageError(f"{count} settings, more than {MOST_SETTINGS}: fewer --points or values, please")
    grid = [dict(zip(paths, values, strict=True)) for values in product(*(each.values for each in axes))]
    best = _best(tuning, grid)
    free = [each for each in axes if each.continuous]
    if refine and free:
        best = _best(tuning, [best, *_searched(tuning, best, free)])
    curves = {}
    for each in axes:
        along = {value: {**best, each.path: value} for value in _sorted({*each.values, best[each.path]})}
        curves[each.path] = list(zip(along, tuning(list(along.values())), strict=True))
    before = {each.path: current(spec, each.path) for each in axes}
    test = Bench(cell.spec, spec, metric, seed, runs, wanted)
    test_before, test_chosen = test([{}, best])
    return Tuned(cell, before, best, curves, test_before, test_chosen, len(tuning.scores))


def _best(bench: Bench, settings: Sequence[Setting]) -> Setting:
    """The first of the best settings."""
    scores = bench(settings)
    best = min(range(len(settings)), key=lambda i: scores[i].rank)
    if scores[best].rank[1] == math.inf:
        raise RkfbenchError("the metric is not defined under any setting: all runs failed")
    return settings[best]


def _searched(bench: Bench, best: Setting, free: Sequence[Axis]) -> list[Setting]:
    """The settings that an optimiser tries around the best one of the grid."""
    from scipy.optimize import minimize, minimize_scalar

    tried: list[Setting] = []
    bounds = [each.gap(best[each.path]) for each in free]

    def objective(x: Any) -> float:
        values = {each.path: each.value(float(at)) for each, at in zip(free, np.atleast_1d(x), strict=True)}
        tried.append(best | values)
        failed, mean = bench([tried[-1]])[0].rank
        return math.inf if failed > least else mean

    least = bench([best])[0].rank[0]
    if len(free) == 1:
        (low, high) = bounds[0]
        options: dict[str, Any] = {"xatol": TOLERANCE * (high - low), "maxiter": MOST_STEPS[1]}
        minimize_scalar(objective, bounds=(low, high), method="bounded", options=options)
    else:
        start = [each.scaled(best[each.path]) for each in free]
        options = {
            "maxfev": MOST_STEPS[2],
            "xatol": 0.0,  # it takes all its steps: no tolerance fits every metric
            "fatol": 0.0,
            "initial_simplex": _simplex(start, bounds),
        }
        minimize(objective, start, method="Nelder-Mead", bounds=bounds, options=options)
    return tried


def _simplex(start: Sequence[float], bounds: Sequence[tuple[float, float]]) -> Array:
    """The start and one more corner along each parameter: half way to the farther bound."""
    corners = np.tile(np.array(start), (len(start) + 1, 1))
    for i, (low, high) in enumerate(bounds):
        far = high if high - start[i] >= start[i] - low else low
        corners[i + 1, i] = (start[i] + far) / 2
    return corners


def _sorted(values: set[Any]) -> list[Any]:
    return sorted(values, key=lambda value: (isinstance(value, str), value))
