"""The commands that look into filters: tune, trace."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from rkfbench.cli.common import command
from rkfbench.cli.options import Cases, Reading, Runs, ScenarioName, Seed, Sets, Sweeps
from rkfbench.cli.terminal import Terminal

OneFilter = Annotated[str, typer.Option("--filter", help="A filter of the scenario by its label.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands of this file."""
    for each in (tune, trace):
        app.command()(each)


@command
def tune(
    terminal: Terminal,
    scenario: ScenarioName,
    label: OneFilter,
    over: Annotated[
        list[str],
        typer.Option("--over", metavar="PARAMETER=A:B", help="Range to search: first:last[:count], or a,b,c."),
    ],
    metric: Annotated[
        str | None,
        typer.Option("--metric", help="What is made small, or large (log_likelihood); default: the score, else rmse."),
    ] = None,
    points: Annotated[int | None, typer.Option("--points", min=2, help="Points of the grid along a range.")] = None,
    grid: Annotated[bool, typer.Option("--grid", help="The grid alone, without the optimiser after it.")] = False,
    cases: Cases = [],
    reading: Reading = None,
    runs: Runs = None,
    seed: Seed = None,
    sets: Sets = [],
    sweeps: Sweeps = [],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files (default: results/SCENARIO~tune-FILTER,OPTIONS).")
    ] = None,
) -> None:
    """Find the best parameters of a filter, case by case, on tuning runs; report them on the test runs.

    The best have the smallest mean of the metric, or the largest where larger is better (log_likelihood). One of which
    neither is better, such as nees or sd, is refused.

    The tuning runs have a seed of their own, so the choice does not profit from the runs that judge it.
    """
    from rkfbench.report.tuned import NAMES, choices, sentence, write
    from rkfbench.reproduce import RESULTS
    from rkfbench.scenario import load, pick
    from rkfbench.store import files, loose
    from rkfbench.study.axes import axes_of
    from rkfbench.study.tune import POINTS
    from rkfbench.study.tune import tune as tuned

    loaded = load(scenario, sets=sets, sweeps=sweeps, runs=runs, seed=seed)
    options = {"metric": metric, "points": points, "grid": grid or None, "reading": reading, "runs": runs, "seed": seed}
    of = _told(f"tune-{label}", [*over, *cases, *sets, *sweeps], options)
    folder = out or RESULTS / f"{loaded.name}~{files.slug(of)}"
    loose.refuse_foreign(folder, NAMES, f"{loaded.name} {of}")  # before the search, which may take long
    found = []
    for cell in pick.cells(loaded, cases, reading):
        spec = pick.filter_of(cell, label)
        axes = axes_of(over, spec, points or POINTS.get(len(over), 5))
        goal = metric or cell.spec.get("score") or "rmse"
        found.append(tuned(cell, spec, axes, goal, seed=loaded.seed, runs=loaded.runs, refine=not grid))
        terminal.note(sentence(found[-1], axes))
    paths = write(folder, found, label, goal)
    loose.record(folder, paths, f"{loaded.name} {of}")
    for path in paths:
        terminal.note(str(path))
    rows = list(choices(found, label, goal))
    hidden = ("reading", "filter", "metric", "sd", "median", "q05", "q95", "max")
    terminal.records(rows, [name for name in rows[0] if terminal.json or name not in hidden])


@command
def trace(
    terminal: Terminal,
    scenario: ScenarioName,
    label: OneFilter,
    run: Annotated[int | None, typer.Option("--run", min=0, help="Number of the run, from 0.")] = None,
    worst: Annotated[bool, typer.Option("--worst", help="The run of the study with the largest error.")] = False,
    metric: Annotated[
        str | None, typer.Option("--metric", help="What is worst in the worst run (default: the scenario's score).")
    ] = None,
    case: Annotated[str | None, typer.Option("--case", help="The case, where there are several.")] = None,
    reading: Reading = None,
    runs: Runs = None,
    seed: Seed = None,
    sets: Sets = [],
    sweeps: Sweeps = [],
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the files (default: results/SCENARIO~trace,OPTIONS).")
    ] = None,
) -> None:
    """Show one run of one filter from the inside: truth, measurements, estimates, innovations, weights, flags."""
    from rkfbench import trace as traces
    from rkfbench.errors import UsageError
    from rkfbench.report.traced import names, write
    from rkfbench.reproduce import RESULTS, folder_of
    from rkfbench.scenario import load, pick
    from rkfbench.store import files, loose

    if (run is not None) == worst:
        raise UsageError("which run? give either --run N or --worst")
    loaded = load(scenario, sets=sets, sweeps=sweeps, runs=runs, seed=seed)
    cell = pick.one_cell(loaded, case, reading)
    pick.filter_of(cell, label)
    if run is not None and runs is not None and run >= runs:
        raise UsageError(f"run {run}: with --runs {runs}, --run is 0 to {runs - 1}")
    of = _told("trace", [*sets, *sweeps], {"reading": reading, "seed": seed})
    folder = out or RESULTS / f"{loaded.name}~{files.slug(of)}"
    loose.refuse_foreign(folder, (), of)
    if run is None:
        goal = metric or cell.spec.get("score") or "rmse"
        numbers = {"runs": runs, "seed": seed}
        overrides = [*sets, *sweeps, *(f"{name}={value}" for name, value in numbers.items() if value is not None)]
        run, value = traces.worst(loaded, cell, label, goal, folder_of(loaded, overrides))
        terminal.note(f"run {run} of {loaded.runs}: {goal} = {value:.6g}")
    found = traces.trace(cell, loaded.seed, run, label)
    loose.refuse_foreign(folder, names(found), f"{loaded.name} {of}")
    paths = write(folder, found)
    loose.record(folder, paths, f"{loaded.name} {of}")
    for path in paths:
        (terminal.note if terminal.json else terminal.data)(str(path))
    if terminal.json:
        terminal.object([dict(zip(found.columns, row, strict=True)) for row in found.rows()])


def _told(what: str, texts: Sequence[str], options: Mapping[str, Any]) -> str:
    """What makes results these and no others, in one line, by which their folder is called."""
    return ",".join([what, *texts, *(f"{name}={value}" for name, value in options.items() if value is not None)])
