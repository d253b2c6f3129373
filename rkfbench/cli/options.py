"""The options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ScenarioName = Annotated[str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a bundled one.")]
Sets = Annotated[list[str], typer.Option("--set", metavar="PATH=VALUE", help="Override an entry of the scenario.")]
Sweeps = Annotated[
    list[str], typer.Option("--sweep", metavar="PATH=A:B:N", help="Add a sweep: first:last:count, or a,b,c.")
]
Runs = Annotated[int | None, typer.Option("--runs", min=1, help="Monte Carlo runs.")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of all random streams.")]
Full = Annotated[bool, typer.Option("--full", help="Also extras and the sensitivity study.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Compute everything anew.")]
Jobs = Annotated[int | None, typer.Option("--jobs", min=1, help="Processes (default: all cores when it pays).")]
Scheduler = Annotated[
    str | None,
    typer.Option("--scheduler", metavar="ADDRESS", help="Dask scheduler; 'local' starts one here with --jobs workers."),
]
Precision = Annotated[
    list[str],
    typer.Option(
        "--precision",
        metavar="[METRIC=]NUMBER",
        help="Run until the relative standard error is that small in all cases (default: the score or first metric). "
        "Runs come in whole blocks: 524288 / steps of them, at least 128 and at most 4096.",
    ),
]
MaxRuns = Annotated[int | None, typer.Option("--max-runs", min=1, help="Where --precision gives up (100000).")]
ShardOf = Annotated[
    str | None, typer.Option("--shard", metavar="I/N", help="Compute one part of the blocks only; a plain run merges.")
]
Out = Annotated[Path | None, typer.Option("--out", help="Folder for the results (default: results/SCENARIO).")]
Cases = Annotated[list[str], typer.Option("--case", help="A case by its label or a part of it (default: all).")]
Reading = Annotated[str | None, typer.Option("--reading", help="A reading of the scenario (default: the first).")]
