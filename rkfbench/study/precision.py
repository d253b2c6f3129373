"""Precision on demand: as many runs as it takes until every mean is known well enough.

    relative standard error   se / |mean| over the runs 0 .. N - 1, for N at the ends of blocks, in their order

The first such N at which it is small enough for every case and every ranked filter is the number of runs of the study:
a function of the numbers alone, whatever was computed ahead and by which engine. (References, extras and switches are
not asked.) A number of runs that depends on the numbers bends intervals, so whoever judges such a study must say so.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench import metrics
from rkfbench.errors import UsageError
from rkfbench.references import is_reference
from rkfbench.store import blocks
from rkfbench.store.blocks import Array
from rkfbench.study import plan

if TYPE_CHECKING:
    from rkfbench.scenario import Scenario
    from rkfbench.study.plan import Unit

MOST_RUNS = 100_000  # unless told otherwise
GROWTH = 4  # so many times the runs there are, at most, are computed before looking again


@dataclass(frozen=True)
class Goal:
    """Largest relative standard error by metric, and the number of runs at which to give up."""

    relative: Mapping[str, float]
    most: int = MOST_RUNS

    @classmethod
    def of(cls, texts: Sequence[str], most: int | None, scenario: Scenario) -> Goal:
        """The goal that `--precision 0.01` or `--precision METRIC=0.01` sets; UsageError where it makes no sense.

        Without a metric it is about the scenario's score, or its first metric where the score is not measured.
        """
        if any(cell.spec.get("data") for cell in scenario.cells):
            raise UsageError("--precision chooses the number of runs, and recorded data has its own: leave it out")
        measured = [each for each in scenario.cells[0].spec["metrics"] if not metrics.get(each).curve]
        if not measured:
            raise UsageError("--precision: the scenario measures only curves: give it a metric of a whole run")
        if not any(_compared(spec) for cell in scenario.cells if not cell.extra for spec in cell.spec["filters"]):
            raise UsageError("--precision: the scenario compares no filters, it has references and extras only")
        relative: dict[str, float] = {}
        for text in texts:
            name, _, number = text.rpartition("=")
            try:
                value = float(number)
            except ValueError:
                value = math.nan
            if not 0 < value < math.inf:
                raise UsageError(f"--precision {text}: should be a positive number or METRIC=NUMBER, such as rmse=0.01")
            relative[name or _score(scenario, measured)] = value
        for name in relative:
            if name not in measured:
                raise UsageError(
                    f"--precision: the scenario does not measure {name}: "
                    f"write --precision METRIC=0.01 with one of {', '.join(measured)}"
                )
        return cls(relative, MOST_RUNS if most is None else most)

    def __str__(self) -> str:
        return ", ".join(f"{name}={value:g}" for name, value in self.relative.items())


@dataclass(frozen=True)
class Settled:
    """The number of runs of a study that was stopped, and why there: the relative error farthest from its goal."""

    goal: Goal
    runs: int
    reached: bool
    largest: float
    of: str

    def __str__(self) -> str:
        what = "reached" if self.reached else "not reached"
        return (
            f"stopped at {self.runs} runs: precision {self.goal} {what} "
            f"(farthest: relative standard error {self.largest:.2g} of {self.of})"
        )

    def facts(self) -> dict[str, Any]:
        """What the manifest says of it."""
        return {
            "goal": dict(self.goal.relative),
            "max_runs": self.goal.most,
            "runs": self.runs,
            "reached": self.reached,
            "largest": self.largest if math.isfinite(self.largest) else None,
            "of": self.of,
            "text": str(self),
        }


@dataclass
class Search:
    """Looks at the ends of blocks, one after the other, as more of them become known."""

    goal: Goal
    step: int  # runs of the largest blocks: at their ends all cases may stop
    known: int = 0
    settled: Settled | None = None
    _last: tuple[float, float, str] = field(default=(math.inf, math.inf, ""), repr=False)

    def ahead(self) -> int:
        """How many runs to compute before looking again: as many as the errors so far promise to be enough."""
        needed = self.known * self._last[0] ** 2 if self.known and self._last[0] < math.inf else math.inf
        steps = max(self.known + self.step, min(needed, GROWTH * self.known))
        return min(self.goal.most, self.step * math.ceil(steps / self.step))

    def look(self, units: Sequence[Unit], runs: int) -> None:
        """Take in the blocks of the first `runs` runs."""
        series = list(_series(units, self.goal))
        if not series:
            raise UsageError(f"no filter here has the metrics {', '.join(self.goal.relative)} of --precision")
        while self.known < runs and self.settled is None:
            self.known = min(self.known + self.step, runs)
            self._last = max(
                (error(values[: self.known]) / goal, error(values[: self.known]), of)
                for values, goal, error, of in series
            )
            ratio, largest, of = self._last
            if ratio <= 1 or self.known == self.goal.most:
                self.settled = Settled(self.goal, self.known, ratio <= 1, largest, of)


def relative_error(values: Array) -> float:
    """se / |mean| over the values that are not NaN; infinite where there are fewer than two, or their mean is 0."""
    values = values[~np.isnan(values)]
    if len(values) < 2:
        return math.inf
    with np.errstate(over="ignore", invalid="ignore"):
        mean, se = abs(float(values.mean())), float(values.std(ddof=1)) / math.sqrt(len(values))
    if se == 0:
        return 0.0
    return se / mean if mean and math.isfinite(se) else math.inf


def _half(values: Array) -> float:
    """Of the root of a mean, by the delta method."""
    return relative_error(values) / 2


def _series(units: Sequence[Unit], goal: Goal) -> Iterator[tuple[Array, float, Any, str]]:
    """For each metric, case and ranked filter: a value a run (NaN: does not count), the goal, the error, a name."""
    cells: dict[int, list[Unit]] = {}
    for unit in units:
        if not unit.cell.extra and unit.cell.switch is None:
            cells.setdefault(id(unit.cell), []).append(unit)
    for of_cell in cells.values():
        labels = [label for label in of_cell[0].labels if _ranked(of_cell[0], label)]
        parts = [blocks.read(unit.path, set(labels)) for unit in of_cell]
        for label in labels:
            for name, relative in goal.relative.items():
                if name not in parts[0][label].values:
                    continue
                metric = metrics.get(name)
                values = np.concatenate([part[label].values[name] for part in parts])
                out = np.concatenate([part[label].lost if metric.tracking else part[label].failed for part in parts])
                error = _half if metric.root else relative_error
                of = f"{name} of {label} in {plan.name(of_cell[0].cell)}"
                yield np.where(out, np.nan, values), relative, error, of


def _ranked(unit: Unit, label: str) -> bool:
    """Whether a filter is compared with others: neither an extra nor a reference."""
    return _compared(next(each for each in unit.cell.spec["filters"] if each["label"] == label))


def _compared(spec: Mapping[str, Any]) -> bool:
    return not any(spec.get(key) for key in ("extra", "timing")) and not is_reference(spec)


def _score(scenario: Scenario, measured: Sequence[str]) -> str:
    """The metric by which runs are judged, as the scenario measures it; the first of `measured` where it does not."""
    usual = ("score", scenario.cells[0].spec.get("score") or "rmse")
    return next((name for name in usual if name in measured), measured[0])
