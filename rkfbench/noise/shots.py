"""Shot noise: large Gaussian values added at a few random times of each run.

Source: `outliers(N, t)` of the FP-MCS paper, section 3: ten times t = 50 rand in every run and channel, at each of
them a value from N(1, 100). Real-valued times
are no sample times, so t is rounded up to 1..50; times are drawn with replacement, and values at equal times add up. A
shot in the process at t is part
of w_t and acts on x_{t+1}; a shot in the measurement at t is part of v_t and acts on y_t.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from annotated_types import Ge

from rkfbench.errors import SpecError, did_you_mean
from rkfbench.linalg import Array
from rkfbench.noise.base import Sample
from rkfbench.streams import Streams


@dataclass(frozen=True)
class Shots:
    """`count` values from N(mean, variance) at random times within the window, one a component, in every run."""

    channel: Annotated[Literal["process", "measurement"], "what is disturbed"]
    count: Annotated[int, Ge(1), "shots a run"] = 10
    window: Annotated[
        tuple[Annotated[int, Ge(0)], Annotated[int, Ge(1)]], "times t = ceil of a uniform number in it, at least 1"
    ] = (0, 50)
    mean: Annotated[float, "mean of a shot"] = 1.0
    variance: Annotated[float, Ge(0), "variance of a shot"] = 100.0
    components: Annotated[tuple[str, ...] | None, "names of the components that are hit; default: all"] = None
    same_times: Annotated[bool, "the times of the process and of the measurement are the same ones"] = False

    def __post_init__(self) -> None:
        if self.window[0] >= self.window[1]:
            raise ValueError("the window is empty")

    def check(self, names: tuple[str, ...], steps: int) -> None:
        """SpecError where a component does not exist or the window leaves the run."""
        for i, name in enumerate(self.components or ()):
            if name not in names:
                raise SpecError(
                    f"there is no component '{name}'{did_you_mean(name, names)} (known: {', '.join(names)})",
                    ["components", i],
                )
        if self.window[1] > steps:
            raise SpecError(f"step {self.window[1]} is not within 1..{steps}", ["window"])

    def times(self, draw: Streams) -> np.ndarray:
        """The times t of the shots, (count, M)."""
        low, high = self.window
        common = Streams(draw.seed, draw.first, draw.groups, "disturbance/shots/")
        u = (common if self.same_times else draw).uniform("time", self.count)
        return np.maximum(np.ceil(low + (high - low) * u), 1).astype(np.intp)

    def sample(self, draw: Streams, steps: int, names: tuple[str, ...]) -> Sample:
        """What is added, (T, d, M): given its times a Gaussian."""
        hit = np.array([name in (self.components or names) for name in names], dtype=float)
        rows = self.times(draw) - (1 if self.channel == "measurement" else 0)
        size = self.mean + np.sqrt(self.variance) * draw.normal("value", self.count, len(names))
        value = np.zeros((steps + 1, len(names), draw.runs))
        shots = np.zeros((steps + 1, draw.runs))
        runs = np.arange(draw.runs)
        for row, each in zip(rows, size, strict=True):  # within one shot all pairs (row, run) differ
            value[row, :, runs] += (hit[:, None] * each).T
            shots[row, runs] += 1
        value, shots = value[:steps], shots[:steps]  # a shot in the process at the last step acts on a state beyond it

        def cov() -> Array:
            return self.variance * shots[:, None, None] * np.diag(hit)[..., None]

        return Sample(value, cov, self.mean * hit[:, None] * shots[:, None], (shots[:, None] > 0) & (hit[:, None] > 0))
