"""The catalogue's filters on the problems of the contract, for the tests that run all of them."""

from __future__ import annotations

from typing import Any

from rkfbench import contract
from rkfbench.contract import SPECS
from rkfbench.filters import FILTERS, build

__all__ = ["PROBLEMS", "SPECS", "arguments", "serves"]

# Parameters that a filter cannot do without, by filter name.
POINT = {"at": 4, "lag": 4}
REQUIRED: dict[str, dict[str, Any]] = {
    "fixed_point": {"filter": "kf", **POINT},
    "decoupled": {"filter": "kf", "parts": [["px", "py", "vx", "vy"]]},
    **dict.fromkeys(("ks", "fpmcs", "ps"), POINT),
}
PROBLEMS = {each.name: (each.experiment, each.world) for each in contract.problems()}


def arguments(name: str, problem: str) -> dict[str, Any]:
    """What the filter cannot do without on this problem."""
    return REQUIRED.get(name, {})


def serves(name: str, problem: str) -> bool:
    """Whether the filter can run on the problem."""
    assert name in FILTERS
    (found,) = (each for each in contract.problems() if each.name == problem)
    return found.serves(build(name, **arguments(name, problem)))
