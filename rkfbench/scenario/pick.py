"""Picking cells and filters of a scenario by the names that a user gives."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rkfbench.errors import UsageError, did_you_mean
from rkfbench.scenario.display import case_matches
from rkfbench.scenario.scenario import Cell, Scenario


def cells(scenario: Scenario, cases: Sequence[str] = (), reading: str | None = None) -> list[Cell]:
    """The cells of the named cases (by label or a part of it) under a reading, the first one by default; without names
    all that are not extra. UsageError for a name that nothing has.
    """
    readings = list(dict.fromkeys(cell.reading for cell in scenario.cells))
    chosen = reading or readings[0]
    if chosen not in readings:
        raise UsageError(f"{scenario.name} has no reading '{chosen}'{did_you_mean(chosen, readings)}")
    there = [cell for cell in scenario.cells if cell.reading == chosen]
    for name in cases:
        if not any(case_matches(name, cell.case) for cell in there):
            known = [cell.case for cell in there]
            guess = did_you_mean(name, known) or f" (it has {', '.join(known)})"
            raise UsageError(f"{scenario.name} has no case '{name}'{guess}")
    if cases:
        return [cell for cell in there if any(case_matches(name, cell.case) for name in cases)]
    return [cell for cell in there if not cell.extra] or there


def one_cell(scenario: Scenario, case: str | None, reading: str | None) -> Cell:
    """The only cell that is meant; UsageError that lists the cases where there are several."""
    found = cells(scenario, [case] if case is not None else [], reading)
    exact = [cell for cell in found if cell.case == case]
    if len(exact or found) > 1:
        raise UsageError(f"which case? add --case and one of: {', '.join(cell.case for cell in found)}")
    return (exact or found)[0]


def filter_of(cell: Cell, label: str) -> dict[str, Any]:
    """The description of a filter of a cell; UsageError where it has none of that label."""
    known = {each["label"]: each for each in cell.spec["filters"]}
    if label not in known:
        guess = did_you_mean(label, known) or f" (it has {', '.join(known)})"
        raise UsageError(f"the scenario has no filter '{label}'{guess}")
    found: dict[str, Any] = known[label]
    return found
