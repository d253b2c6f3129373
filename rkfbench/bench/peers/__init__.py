"""All implementations that are compared: ours, plain C, and other libraries.

Each module gives `PEERS` and `missing()`: why they cannot run on this machine, or None. Nothing is imported or compiled
before a peer is made ready.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rkfbench.bench.peers import (
    dynamax_vmap,
    filterpy_loop,
    jax_vmap,
    numpy_loop,
    ours,
    plain_c,
    pykalman_loop,
    simdkalman_batch,
    stone_soup,
)
from rkfbench.bench.peers.base import Peer, Task

__all__ = ["FILTERS", "MODULES", "Peer", "Task", "absent", "peers"]

MODULES = (
    ours, plain_c, dynamax_vmap, jax_vmap, simdkalman_batch, filterpy_loop, pykalman_loop, stone_soup, numpy_loop
)  # fmt: skip
FILTERS = tuple(dict.fromkeys(peer.filter for peer in ours.PEERS))


def peers(filters: Sequence[str]) -> Iterator[Peer]:
    """The peers that can run here, filter after filter, ours first."""
    here = [peer for module in MODULES if module.missing() is None for peer in module.PEERS]
    return (peer for name in filters for peer in here if peer.filter == name)


def absent() -> dict[str, str]:
    """Which peers cannot run here, and why."""
    reasons = ((module.PEERS[0].name, module.missing()) for module in MODULES)
    return {name: why for name, why in reasons if why is not None}
