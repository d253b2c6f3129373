"""Scripted trajectories: truths that follow a script, not the model with its process noise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

from rkfbench.catalogue import Entry, build_kind
from rkfbench.linalg import Array


class Truth(Protocol):
    """A trajectory that is the same in all runs."""

    def check(self, states: tuple[str, ...]) -> None:
        """SpecError if the script is not about these states."""
        ...

    def states(self, steps: int) -> Array:
        """The true states x_1 .. x_T, (T, n)."""
        ...


TRUTHS: dict[str, Entry] = {
    "drive": Entry("rkfbench.models.drive:Drive", paper="daf"),
}


def build(spec: Mapping[str, Any]) -> Truth:
    """The trajectory that `{kind: name, **parameters}` describes."""
    truth: Truth = build_kind(TRUTHS, "scripted truth", spec)
    return truth
