"""The commands for programs in other languages: export, score."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rkfbench.cli import running
from rkfbench.cli.common import command
from rkfbench.cli.options import Cases, Fresh, Full, Jobs, Reading, Runs, ScenarioName, Seed, Sets, Sweeps
from rkfbench.cli.terminal import Terminal


def add_to(app: typer.Typer) -> None:
    """Add the commands of this file."""
    for each in (export, score):
        app.command()(each)


@command
def export(
    terminal: Terminal,
    scenario: ScenarioName,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files (default: results/SCENARIO~export).")
    ] = None,
    runs: Runs = None,
    cases: Cases = [],
    reading: Reading = None,
    filters: Annotated[
        list[str], typer.Option("--filter", help="Also the estimates of this filter of the scenario, by its label.")
    ] = [],
    sets: Sets = [],
    sweeps: Sweeps = [],
    seed: Seed = None,
) -> None:
    """Write truth and measurements of a study for other programs: CSV, MAT-files, and what filters are told as JSON."""
    from rkfbench.export import export as written
    from rkfbench.reproduce import RESULTS
    from rkfbench.scenario import load, pick

    loaded = load(scenario, sets=sets, sweeps=sweeps, runs=runs, seed=seed)
    cells = pick.cells(loaded, cases, reading)
    for cell in cells:
        for label in filters:
            pick.filter_of(cell, label)
    files = written(loaded, cells, out or RESULTS / f"{loaded.name}~export", filters)
    if terminal.json:
        terminal.object([str(path) for path in files])
    else:
        for path in files:
            terminal.data(str(path))
    terminal.note(f"{loaded.name}: {len(cells)} cases, {loaded.runs} runs; rkfbench score reads the estimates")


@command
def score(
    terminal: Terminal,
    scenario: ScenarioName,
    estimates: Annotated[
        list[Path], typer.Argument(help="CSV files with the columns case, run, k and the states (rkfbench export).")
    ],
    labels: Annotated[
        list[str], typer.Option("--label", help="Name in the results, one a file (default: the file's name).")
    ] = [],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the results (default: results/SCENARIO~score).")
    ] = None,
    runs: Runs = None,
    sets: Sets = [],
    sweeps: Sweeps = [],
    seed: Seed = None,
    full: Full = False,
    fresh: Fresh = False,
    jobs: Jobs = None,
) -> None:
    """Put the estimates of filters written elsewhere into tables, figures and ledger beside the built-in ones.

    The study has as many runs as the files, unless --runs says less.
    """
    from rkfbench.errors import UsageError
    from rkfbench.filters.estimates import runs_of
    from rkfbench.pool import Pool
    from rkfbench.reproduce import RESULTS
    from rkfbench.scenario import load

    if labels and len(labels) != len(estimates):
        raise UsageError(f"{len(labels)} labels for {len(estimates)} files: give each file one --label, or none")
    names = labels or [path.stem for path in estimates]
    if len(set(names)) < len(names):
        raise UsageError("two files have the same label: tell them apart with --label")
    there = min(runs_of(path) for path in estimates)
    named = dict(zip(names, estimates, strict=True))
    loaded = load(scenario, sets=sets, sweeps=sweeps, runs=runs or there, seed=seed, estimates=named)
    folder = out or RESULTS / f"{loaded.name}~score"
    with Pool(jobs) as pool:
        outcomes = running.experiments(terminal, [(loaded, folder)], pool, full=full, fresh=fresh, jobs=jobs)
    running.show(terminal, outcomes)
