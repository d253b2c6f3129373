"""Random streams: common random numbers for every filter, reading and case of a study.

A draw depends on (seed, purpose, group of 128 runs) only: each pair of purpose and group has a generator of its own,
`SFC64(SeedSequence(seed, spawn_key=(crc32(purpose), group)))`, and is drawn whole, time slowest and runs last. So the
first runs of a long study are the short study, the first steps of a long run are the short run, and no draw moves when
filters, cases, workers or block sizes change.

Purposes are primitives ("process/normal", "measurement/coin", ...); noise laws build their values from them, so cases
that differ in a rate or a scale share the coins and normals behind it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any
from zlib import crc32

import numpy as np

from rkfbench.linalg import Array

GROUP = 128  # runs drawn together; the unit of randomness


@dataclass(frozen=True)
class Streams:
    """The streams of the groups first .. first + groups - 1: every draw has shape (*shape, 128 * groups)."""

    seed: int
    first: int = 0
    groups: int = 1
    scope: str = ""

    @property
    def runs(self) -> int:
        return GROUP * self.groups

    def within(self, scope: str) -> Streams:
        """The same streams with the purposes of one part: `draw.within("process").normal("body", T, n)`."""
        return replace(self, scope=f"{self.scope}{scope}/")

    def generators(self, purpose: str) -> list[np.random.Generator]:
        """One generator a group of runs, for draws of a shape that is not known in advance."""
        key = crc32(f"{self.scope}{purpose}".encode())
        spawn = ((key, self.first + i) for i in range(self.groups))
        return [np.random.Generator(np.random.SFC64(np.random.SeedSequence(self.seed, spawn_key=k))) for k in spawn]

    def normal(self, purpose: str, *shape: int) -> Array:
        """Independent N(0, 1)."""
        return self._draw(purpose, "standard_normal", shape)

    def uniform(self, purpose: str, *shape: int) -> Array:
        """Independent U[0, 1)."""
        return self._draw(purpose, "random", shape)

    def exponential(self, purpose: str, *shape: int) -> Array:
        """Independent Exp with mean 1."""
        return self._draw(purpose, "standard_exponential", shape)

    def _draw(self, purpose: str, method: str, shape: tuple[int, ...]) -> Array:
        return np.concatenate(
            [getattr(generator, method)((*shape, GROUP)) for generator in self.generators(purpose)], axis=-1
        )


@dataclass(frozen=True)
class Remembered(Streams):
    """Streams that draw once what several cases ask for; nobody may write into it."""

    _drawn: dict[tuple[Any, ...], Array] = field(default_factory=dict, repr=False)

    def _draw(self, purpose: str, method: str, shape: tuple[int, ...]) -> Array:
        key = self.scope, purpose, method, shape
        if key not in self._drawn:
            self._drawn[key] = super()._draw(purpose, method, shape)
            self._drawn[key].flags.writeable = False
        return self._drawn[key]


@dataclass(frozen=True)
class Onward(Streams):
    """The streams of one group of runs, `width` values wide, for draws step after step: each call goes on where the
    last one of its purpose stopped.
    """

    width: int = GROUP
    _open: dict[str, np.random.Generator] = field(default_factory=dict, repr=False)

    @property
    def runs(self) -> int:
        return self.width

    def _draw(self, purpose: str, method: str, shape: tuple[int, ...]) -> Array:
        key = f"{self.scope}{purpose}"
        if key not in self._open:
            (self._open[key],) = self.generators(purpose)
        drawn: Array = getattr(self._open[key], method)((*shape, self.width))
        return drawn
