"""What the user should know of runs that failed while a study was computed."""

from __future__ import annotations

from collections.abc import Iterator

from rkfbench.store.blocks import Part
from rkfbench.study.events import Died


class Deaths:
    """How many of the computed runs failed, by filter and case, and how the first of them died."""

    def __init__(self) -> None:
        self._counts: dict[str, dict[str, tuple[int, int]]] = {}  # filter -> case -> runs that failed, runs
        self._first: dict[str, tuple[int, str]] = {}  # filter -> number of the block, what happened

    def add(self, number: int, case: str, label: str, part: Part) -> None:
        """A part that was computed; blocks are numbered in their order, and may arrive in any other."""
        cases = self._counts.setdefault(label, {})
        failed, runs = cases.get(case, (0, 0))
        cases[case] = failed + int(part.failed.sum()), runs + len(part.failed)
        if part.death and number <= self._first.get(label, (number, ""))[0]:
            self._first[label] = number, f"{case}, {part.death}"

    def told(self) -> Iterator[Died]:
        """The filters of which it is known how a run died, and those of which all runs of a case did."""
        for label, cases in self._counts.items():
            lost = [case for case, (failed, runs) in cases.items() if failed == runs]
            if label in self._first or lost:
                failed, runs = map(sum, zip(*cases.values(), strict=True))
                _, first = self._first.get(label) or (0, f"all of {lost[0]}")
                yield Died(label, failed, runs, first)
