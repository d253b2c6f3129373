"""Exact checks: statements of a paper about algebra, theorems or counts, each measured as one deviation that must stay
within a tolerance.

No Monte Carlo error: fixed matrices, or fixed seeds where "any matrix" is meant. They run in the compute stage of a
study and give `checks.csv`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Outcome:
    """The statement holds when deviation <= tolerance; `note` says in a few words what was measured."""

    deviation: float
    tolerance: float
    note: str = ""

    @property
    def holds(self) -> bool:
        return self.deviation <= self.tolerance


Check = Callable[[], Outcome]


def checks_of(paper: str) -> dict[str, Check]:
    """The checks of a paper (`aladkf-2020`) by their full id (`aladkf.T1`); {} for a paper without any."""
    from importlib import import_module

    name = paper.partition("-")[0]
    if name not in PAPERS:
        return {}
    found: dict[str, Check] = import_module(f"rkfbench.claims.checks.{name}").CHECKS
    return {f"{name}.{id}": check for id, check in found.items()}


PAPERS = ("aladkf", "daf", "fpmcs", "nrukf", "pekf")
