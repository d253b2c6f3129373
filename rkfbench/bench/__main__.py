"""`python -m rkfbench.bench` measures, shows what it finds, and writes results/bench."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rkfbench.blas import one_thread


def main(arguments: Sequence[str] | None = None) -> None:
    one_thread()
    from rkfbench.bench import machine, report
    from rkfbench.bench.measure import ROUNDS, SLICE, measure
    from rkfbench.bench.peers import FILTERS, absent

    parser = argparse.ArgumentParser(prog="python -m rkfbench.bench", description="What a run and step costs.")
    parser.add_argument("--filters", nargs="+", choices=FILTERS, default=FILTERS, metavar="FILTER")
    parser.add_argument("--sizes", nargs="+", type=int, metavar="M", help="numbers of runs")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="at least 1")
    parser.add_argument("--slice", type=float, default=SLICE, help="seconds of one measurement")
    parser.add_argument("--out", type=Path, default=Path("results/bench"), help="folder for bench.csv, .md, .png, .pdf")
    args = parser.parse_args(arguments)
    if args.rounds < 1 or min(args.sizes or [1]) < 1:
        parser.error("--rounds and --sizes must be at least 1")
    for name, why in absent().items():
        print(f"{name}: {why}, left out", file=sys.stderr)
    before, costs, paths = machine.load(), [], []
    for name in args.filters:
        for cost in measure([name], args.sizes, args.rounds, args.slice):
            costs.append(cost)
            print(
                f"{cost.filter:8}{cost.runs:7}  {cost.peer:20}{cost.cpu.min():12.1f} ns a run and step"
                f"{cost.wall.min():12.1f} wall, apart {cost.deviation:.0e}",
                file=sys.stderr,
            )
        paths = report.write(args.out, costs, absent(), [before, machine.load()])  # Ctrl-C keeps the finished filters
    for path in paths:
        print(path)


if __name__ == "__main__":
    main()
