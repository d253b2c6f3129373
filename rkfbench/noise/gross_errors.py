"""Gross errors: a fixed amount added to one component at given epochs, in every run alike.

Source: examples 2 and 3 of the DAF paper (300 m on sensor A every 300 s; the sign and the error at the very last epoch
are open there).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge

from rkfbench.errors import SpecError, did_you_mean
from rkfbench.noise.base import Sample
from rkfbench.streams import Streams

Epoch = Annotated[int, Ge(1)]
SIGNS = {"plus": (1.0, 1.0), "minus": (-1.0, -1.0), "alternate": (1.0, -1.0)}


@dataclass(frozen=True)
class GrossErrors:
    """`size` is added to one component at the epochs every, 2 every, ..., or at those listed in `at`."""

    component: Annotated[str, "name of the component"]
    size: Annotated[float, "amount added, in the units of the component"]
    every: Annotated[int | None, Ge(1), "steps between two of them"] = None
    at: Annotated[tuple[Epoch, ...] | None, "the epochs themselves"] = None
    sign: Annotated[Literal["plus", "minus", "alternate"], "of the errors; `alternate` begins with plus"] = "plus"
    last: Annotated[bool, "whether an error falls on the very last step"] = True
    channel: Annotated[Literal["measurement", "process"], "what is disturbed"] = "measurement"

    def __post_init__(self) -> None:
        if (self.every is None) == (self.at is None):
            raise ValueError("exactly one of 'every' and 'at' must be given")

    def epochs(self, steps: int) -> list[int]:
        """The steps with an error."""
        found = list(self.at) if self.at is not None else list(range(self.every or 1, steps + 1, self.every or 1))
        return [k for k in found if self.last or k != steps]

    def check(self, names: tuple[str, ...], steps: int) -> None:
        """SpecError where the component does not exist or an epoch lies outside the run."""
        if self.component not in names:
            known = did_you_mean(self.component, names) or f" (known: {', '.join(names)})"
            raise SpecError(f"there is no component '{self.component}'{known}", ["component"])
        for i, k in enumerate(self.at or ()):
            if k > steps:
                raise SpecError(f"step {k} is not within 1..{steps}", ["at", i])
        if self.every is not None and self.every > steps:
            raise SpecError(f"there is no such step within 1..{steps}", ["every"])

    def sample(self, draw: Streams, steps: int, names: tuple[str, ...]) -> Sample:
        """What is added, (T, d, M), known exactly to those who know the record."""
        i, rows = names.index(self.component), np.array(self.epochs(steps), dtype=np.intp) - 1
        value = np.zeros((steps, len(names), draw.runs))
        value[rows, i] = self.size * np.resize(SIGNS[self.sign], len(rows))[:, None]
        return Sample(value, lambda: np.zeros((1, len(names), len(names), 1)), value, value != 0)
