"""Blocks: fixed groups of consecutive runs, the unit of computing, storing and resuming."""

from __future__ import annotations

from rkfbench.streams import GROUP

WIDEST = 4096  # runs; wider batches gain nothing more
RUN_STEPS = 2**19  # a block's runs x steps: bounds the memory of its histories


def block_size(steps: int) -> int:
    """Runs of a block of a study with that many steps: whole groups, as many as the memory bound allows."""
    return GROUP * max(1, min(WIDEST, RUN_STEPS // steps) // GROUP)
