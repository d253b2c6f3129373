"""`python -m rkfbench.bench`: measure, and show the ratios."""

from __future__ import annotations

import argparse

from rkfbench.blas import one_thread

one_thread()


def main() -> None:
    import numpy as np

    from rkfbench.bench.measure import ROUNDS, measure
    from rkfbench.bench.peers import FILTERS, absent

    parser = argparse.ArgumentParser(prog="python -m rkfbench.bench", description=__doc__)
    parser.add_argument("--filters", nargs="+", choices=FILTERS, default=FILTERS)
    parser.add_argument("--sizes", nargs="+", type=int, default=(1, 100, 1000, 10000), help="numbers of runs M")
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    args = parser.parse_args()
    for name, why in absent().items():
        print(f"{name}: {why}, left out")
    for cost in measure(args.filters, args.sizes, args.rounds):
        print(
            f"{cost.filter:8}{cost.runs:7} {cost.peer:20}{cost.cpu.min():12.1f} ns a run and step (CPU), "
            f"median {np.median(cost.cpu):.1f}, wall {cost.wall.min():.1f}; apart {cost.deviation:.0e}",
            flush=True,
        )


if __name__ == "__main__":
    main()
