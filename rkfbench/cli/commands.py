"""The commands that make results: run, reproduce, validate; `claims` and `look` have those that show what is there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from rkfbench.cli import claims, look
from rkfbench.cli.common import command
from rkfbench.cli.terminal import Terminal

app = typer.Typer(
    help="Experiments on robust Kalman filtering from five papers, and which of their claims hold.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Scenarios = Annotated[list[str], typer.Argument(help="Scenario files, or names of bundled scenarios.")]
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
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler to use; 'local' starts one with --jobs workers."
    ),
]
Precision = Annotated[
    list[str],
    typer.Option(
        "--precision",
        metavar="[METRIC=]NUMBER",
        help="Run until the relative standard error is that small in all cases (default metric: the score).",
    ),
]
MaxRuns = Annotated[int | None, typer.Option("--max-runs", min=1, help="Where --precision gives up (100000).")]
ShardOf = Annotated[
    str | None, typer.Option("--shard", metavar="I/N", help="Compute one part of the blocks only; a plain run merges.")
]
Out = Annotated[Path | None, typer.Option("--out", help="Folder for the results (default: results/SCENARIO).")]


@app.callback(invoke_without_command=True)
def rkfbench(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    if version:
        from rkfbench import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.command()
@command
def run(
    terminal: Terminal,
    scenarios: Scenarios,
    sets: Sets = [],
    sweeps: Sweeps = [],
    runs: Runs = None,
    seed: Seed = None,
    out: Out = None,
    full: Full = False,
    fresh: Fresh = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
    shard: ShardOf = None,
    precision: Precision = [],
    max_runs: MaxRuns = None,
) -> None:
    """Run scenarios: numbers, claims, tables and figures, in results/SCENARIO.

    What is already there is used again. With options that change the scenario the folder is results/SCENARIO~OPTIONS.
    """
    from rkfbench.reproduce import folder_of
    from rkfbench.scenario import load

    _check_together(runs=runs, fresh=fresh, shard=shard, precision=precision, max_runs=max_runs)
    numbers = {"runs": runs, "seed": seed, "max-runs": max_runs}
    overrides = [*sets, *sweeps, *(f"{name}={value}" for name, value in numbers.items() if value is not None)]
    overrides += [f"precision={each}" for each in precision]
    outcomes = []
    for scenario in [load(each, sets=sets, sweeps=sweeps, runs=runs, seed=seed) for each in scenarios]:
        folder = folder_of(scenario, overrides)
        if out is not None:
            folder = out if len(scenarios) == 1 else out / scenario.name
        if shard is not None:
            outcomes.append(_shard(terminal, scenario, folder, shard, full=full, jobs=jobs, scheduler=scheduler))
            continue
        goal = None
        if precision:
            from rkfbench.study.precision import Goal

            goal = Goal.of(precision, max_runs, scenario)
        outcomes.append(
            _experiment(terminal, scenario, folder, full=full, fresh=fresh, jobs=jobs, scheduler=scheduler, goal=goal)
        )
    if terminal.json:
        terminal.object([_as_data(outcome) for outcome in outcomes])
    else:
        for outcome in outcomes:
            terminal.data(str(outcome.folder))
    if any(outcome.failures for outcome in outcomes):
        raise typer.Exit(1)


@app.command()
@command
def reproduce(
    terminal: Terminal,
    reference: Annotated[
        bool, typer.Option("--reference", help="At reference run counts and in full, into results/reference.")
    ] = False,
    full: Full = False,
    fresh: Fresh = False,
    jobs: Jobs = None,
    scheduler: Scheduler = None,
) -> None:
    """Run all bundled scenarios, judge the claims, make the report, compare with results/reference.

    Exit code 3 when our numbers differ from those of the reference by more than chance.
    """
    from rkfbench.errors import Different
    from rkfbench.judge import sentences
    from rkfbench.report.page import write_report
    from rkfbench.reproduce import REFERENCE, RESULTS, compared_with_reference, publish, reference_study
    from rkfbench.scenario import bundled, load

    folders, different, failed = [], [], False
    for scenario in [load(name) for name in bundled()]:
        folder = RESULTS / scenario.name
        if reference:
            scenario, folder = reference_study(scenario)
        outcome = _experiment(
            terminal, scenario, folder, full=full or reference, fresh=fresh, jobs=jobs, scheduler=scheduler
        )
        if outcome.failures:
            failed = True
        elif reference:
            folders.append(publish(folder, REFERENCE / scenario.name))
        else:
            folders.append(folder)
            level = compared_with_reference(folder, scenario.name)
            terminal.note(f"{scenario.name}: against results/reference: {level}")
            different += [scenario.name] * (level == "different")
    if folders:
        report = write_report(folders, REFERENCE if reference else RESULTS)
        rows = [{"paper": paper, "reading": reading, "claims": text} for paper, reading, text in sentences(folders)]
        terminal.records(rows, ["paper", "reading", "claims"])
        terminal.note(f"report: {', '.join(map(str, report))}")
    if failed:
        raise typer.Exit(1)
    if different:
        raise Different(f"different from results/reference: {', '.join(different)} (see rkfbench compare)")


@app.command()
@command
def validate(terminal: Terminal, scenarios: Scenarios, sets: Sets = [], sweeps: Sweeps = []) -> None:
    """Check scenario files; all problems of each file are told with their lines."""
    from rkfbench.errors import ScenarioError, UsageError
    from rkfbench.scenario import load

    verdicts, wrong = [], False
    for each in scenarios:
        try:
            scenario = load(each, sets=sets, sweeps=sweeps)
        except UsageError as error:
            wrong = True
            problems = error.problems if isinstance(error, ScenarioError) else ()
            verdicts.append({"file": each, "valid": False, "problems": [vars(problem) for problem in problems]})
            terminal.error(str(error))
            continue
        readings = len({cell.reading for cell in scenario.cells})
        cases = len({cell.case for cell in scenario.cells})
        filters = len({each["label"] for cell in scenario.cells for each in cell.spec["filters"]})
        verdicts.append({"file": scenario.file, "valid": True, "problems": []})
        if not terminal.json:
            terminal.data(f"{scenario.file}: valid (readings: {readings}, cases: {cases}, filters: {filters})")
    if terminal.json:
        terminal.object(verdicts)
    if wrong:
        raise typer.Exit(UsageError.exit_code)


def _check_together(
    *, runs: int | None, fresh: bool, shard: str | None, precision: list[str], max_runs: int | None
) -> None:
    """UsageError for options that exclude each other."""
    from rkfbench.errors import UsageError

    if precision and runs is not None:
        raise UsageError("--precision finds the number of runs: leave out --runs (--max-runs sets a limit)")
    if max_runs is not None and not precision:
        raise UsageError("--max-runs is the limit of --precision: for a fixed number write --runs")
    if shard is not None and precision:
        raise UsageError("--shard cannot go with --precision, which looks at all blocks")
    if shard is not None and fresh:
        raise UsageError("--shard cannot go with --fresh, which would remove the blocks of other shards")


def _experiment(
    terminal: Terminal,
    scenario: Any,
    folder: Path,
    *,
    full: bool,
    fresh: bool,
    jobs: int | None,
    scheduler: str | None = None,
    goal: Any = None,
) -> Any:
    """One experiment under the eyes of the user."""
    from rkfbench.reproduce import experiment
    from rkfbench.study.engines import engine

    how, argv = engine(jobs, scheduler), ["rkfbench", *sys.argv[1:]]
    with terminal.progress(scenario.name) as listen:
        outcome = experiment(scenario, folder, full=full, fresh=fresh, engine=how, report=listen, argv=argv, goal=goal)
    terminal.note(_summary(scenario.name, outcome))
    return outcome


def _shard(
    terminal: Terminal,
    scenario: Any,
    folder: Path,
    text: str,
    *,
    full: bool,
    jobs: int | None,
    scheduler: str | None,
) -> Any:
    """One shard of an experiment, and what is still to be done; on one core unless told otherwise."""
    from rkfbench.reproduce import shard_of_experiment
    from rkfbench.study.engines import engine
    from rkfbench.study.shards import Shard

    shard, how = Shard.of(text), engine(jobs or 1, scheduler)
    with terminal.progress(scenario.name) as listen:
        outcome = shard_of_experiment(scenario, folder, shard, full=full, engine=how, report=listen)
    done = f"{scenario.name}: shard {shard}: {outcome.computed} blocks computed, {outcome.reused} were there"
    left = (
        f"blocks of the study still to be computed by other shards: {outcome.open}; then"
        if outcome.open
        else "all blocks of the study are there:"
    )
    terminal.note(f"{done}; {left} the same command without --shard makes the tables")
    return outcome


def _summary(name: str, outcome: Any) -> str:
    if outcome.failures:
        return f"{name}: {len(outcome.failures)} failures, told above; what was finished is in {outcome.folder}"
    if not outcome.computed:
        return f"{name}: nothing to compute, {outcome.folder} is up to date"
    reused = f", {outcome.reused} used again" if outcome.reused else ""
    return f"{name}: {outcome.computed} blocks computed{reused} in {outcome.seconds:.1f} s, results in {outcome.folder}"


def _as_data(outcome: Any) -> dict[str, Any]:
    return {
        "folder": str(outcome.folder),
        "computed": outcome.computed,
        "reused": outcome.reused,
        "changed": outcome.changed,
        "runs": outcome.runs,
        "open": outcome.open,
        "seconds": outcome.seconds,
        "failures": [str(failure) for failure in outcome.failures],
    }


claims.add_to(app)
look.add_to(app)
