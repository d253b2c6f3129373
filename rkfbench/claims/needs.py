"""What a cell of a claim needs of an experiment, and why it was not run where the experiment does not give it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from rkfbench.claims.estimand import Estimand
from rkfbench.claims.plan import Cell
from rkfbench.times import FORMS

if TYPE_CHECKING:
    from rkfbench.scenario import Scenario

_IN_A_BATCH = FORMS[1]  # a time that only the full study takes


def why_not_run(cell: Cell, scenario: Scenario) -> str:
    """Why a study of this scenario, as options and edits left it, has no number for a cell."""
    if lacking := next(_lacking(cell, scenario), ""):
        return f"options or an edit changed the experiment: it has no {lacking}"
    return "needs extras: run with --full" if only_full(cell, scenario) else "not measured yet: run again"


def only_full(cell: Cell, scenario: Scenario) -> bool:
    """Whether only `--full` measures it: extra cases or filters, what is chosen on tuning runs, and switches."""
    estimand = cell.form.estimand
    if estimand is None:
        return False
    extra_cases = {each.case for each in scenario.cells if each.extra}
    extras = {spec["label"] for each in scenario.cells for spec in each.spec["filters"] if spec.get("extra")}
    cases, filters, metrics = _asked(estimand)
    extra = bool(extra_cases & cases or extras & filters or _IN_A_BATCH in metrics)
    return extra or bool(estimand.selected) or bool(cell.start)


def _lacking(cell: Cell, scenario: Scenario) -> Iterator[str]:
    """What a cell asks for and the scenario does not say, in words."""
    reading = cell.start or cell.reading
    mine = [each for each in scenario.cells if each.reading == reading]
    if not mine:
        yield f"reading {reading}"
    elif cell.form.estimand is not None:
        cases, filters, metrics = _asked(cell.form.estimand)
        there = [each for each in mine if each.case in cases]
        labels = {spec["label"] for each in there for spec in each.spec["filters"]}
        known = {name for each in there for name in each.spec["metrics"]} | {"lost", "failed", *FORMS}
        yield from (f"case {case}" for case in sorted(cases - {each.case for each in there}))
        yield from (f"filter {label}" for label in sorted(filters - labels))
        yield from (f"metric {metric}" for metric in sorted(metrics - known))


def _asked(estimand: Estimand) -> tuple[set[str], set[str], set[str]]:
    """The cases, filters (candidates in the place of what is chosen) and metrics of its points."""
    points, chosen = estimand.points, dict(estimand.selected)
    filters = {name for point in points for name in point.filter.names()}
    candidates = {name for selected in chosen.values() for name in selected.candidates}
    return (
        {name for point in points for name in point.case.names()},
        filters - chosen.keys() | candidates,
        {name for point in points for name in point.metric.names()},
    )
