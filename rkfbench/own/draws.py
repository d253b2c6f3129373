"""The `draw` of an own noise law: the streams of a study, and a clear word where they are called wrongly.

It has what a law needs and no more: a generator of its own would give the same numbers again at every step of a
particle filter, whose draws go on from step to step.
"""

from __future__ import annotations

from numbers import Integral
from typing import Any

from rkfbench.errors import SpecError
from rkfbench.linalg import Array
from rkfbench.streams import Streams


class Draws:
    """Streams for one sample of the law `name`. Each draw has a purpose, a word of its own: the same word would give
    the same numbers again, so it is refused.
    """

    def __init__(self, streams: Streams, name: str, used: set[str] | None = None) -> None:
        self._streams, self._name = streams, name
        self._used: set[str] = set() if used is None else used

    @property
    def runs(self) -> int:
        """How many values side by side each draw gives."""
        return self._streams.runs

    @property
    def scope(self) -> str:
        """What stands before each purpose."""
        return self._streams.scope

    def within(self, scope: str) -> Draws:
        """The same with the purposes of one part of the law."""
        return Draws(self._streams.within(scope), self._name, self._used)

    def normal(self, purpose: str, *shape: int) -> Array:
        """Independent N(0, 1), (*shape, runs)."""
        return self._checked("normal", purpose, shape).normal(purpose, *shape)

    def uniform(self, purpose: str, *shape: int) -> Array:
        """Independent U[0, 1), (*shape, runs)."""
        return self._checked("uniform", purpose, shape).uniform(purpose, *shape)

    def exponential(self, purpose: str, *shape: int) -> Array:
        """Independent Exp with mean 1, (*shape, runs)."""
        return self._checked("exponential", purpose, shape).exponential(purpose, *shape)

    def _checked(self, method: str, purpose: Any, shape: tuple[Any, ...]) -> Streams:
        if not isinstance(purpose, str) or not all(isinstance(each, Integral) for each in shape):
            given = ", ".join(map(repr, (purpose, *shape)))
            raise SpecError(
                f"sample of {self._name} calls draw.{method}({given}): first comes a purpose, any word, then the shape "
                f"without the runs, number by number: draw.{method}('value', steps, dim)"
            )
        word = f"{self.scope}{purpose}"
        if word in self._used:
            raise SpecError(
                f"sample of {self._name} draws the purpose '{purpose}' twice, which gives the same random numbers: "
                "give each draw a word of its own, or each part draw.within('part')"
            )
        self._used.add(word)
        return self._streams
