"""Shards: a study divided between processes that know nothing of each other, such as the tasks of an array job.

Shard i of n takes every n-th block, counted over all cases; it writes blocks and nothing else. When all are there, a
plain run makes the tables from them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rkfbench.errors import UsageError


@dataclass(frozen=True)
class Shard:
    """Shard `number` (from 1) of `count`."""

    number: int
    count: int

    @classmethod
    def of(cls, text: str) -> Shard:
        """The shard that `--shard i/n` names; UsageError where there is none."""
        match = re.fullmatch(r"(\d+)/(\d+)", text.strip())
        if not match or not 1 <= int(match[1]) <= int(match[2]):
            raise UsageError(f"--shard {text}: should be written i/n with i from 1 to n, such as 3/8")
        return cls(int(match[1]), int(match[2]))

    def has(self, index: int) -> bool:
        """Whether the block number `index` (from 0) of the whole study is its own."""
        return index % self.count == self.number - 1

    def __str__(self) -> str:
        return f"{self.number}/{self.count}"
