"""The commands that make results: run, reproduce, validate; `claims` and `look` have those that show what is there."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from rkfbench.cli import claims, exchange, inspect, look, own, running
from rkfbench.cli.common import command
from rkfbench.cli.options import (
    Fresh,
    Full,
    Jobs,
    MaxRuns,
    Out,
    Precision,
    Runs,
    Scheduler,
    Seed,
    Sets,
    ShardOf,
    Sweeps,
)
from rkfbench.cli.terminal import Terminal


class Commands(TyperGroup):
    """The commands; what is wrong with an option is said without the words of the library that finds it."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = re.sub("^(Value error, |Input )", "", error.message)
            raise


app = typer.Typer(
    cls=Commands,
    help="Experiments on robust Kalman filtering from five papers, and which of their claims hold.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

# what the processes of reproduce import, to compute and to draw
WORKING = (
    *("rkfbench.study.compute", "rkfbench.report.render", "rkfbench.report.margins", "rkfbench.report.fonts"),
    *("matplotlib.backends.backend_agg", "matplotlib.backends.backend_pdf"),
)
Scenarios = Annotated[list[str], typer.Argument(help="Scenario files, or names of bundled scenarios.")]


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
    from rkfbench.pool import Pool
    from rkfbench.reproduce import folder_of
    from rkfbench.scenario import load

    _check_together(runs=runs, fresh=fresh, shard=shard, precision=precision, max_runs=max_runs)
    numbers = {"runs": runs, "seed": seed, "max-runs": max_runs}
    overrides = [*sets, *sweeps, *(f"{name}={value}" for name, value in numbers.items() if value is not None)]
    overrides += [f"precision={each}" for each in precision]
    loaded = [load(each, sets=sets, sweeps=sweeps, runs=runs, seed=seed) for each in scenarios]
    for scenario in loaded:
        running.unmeasured(terminal, scenario)
    folders = [folder_of(scenario, overrides) for scenario in loaded]
    if out is not None:
        folders = [out if len(loaded) == 1 else out / scenario.name for scenario in loaded]
    _check_apart(folders)
    studies = list(zip(loaded, folders, strict=True))
    if shard is None:
        goals = [running.goal(terminal, scenario, precision, max_runs) for scenario in loaded]
        with Pool(jobs) as pool:
            outcomes = running.experiments(
                terminal, studies, pool, full=full, fresh=fresh, jobs=jobs, scheduler=scheduler, goals=goals
            )
    else:
        outcomes = running.shards(terminal, studies, shard, full=full, jobs=jobs, scheduler=scheduler)
    running.show(terminal, outcomes)


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
    from rkfbench.derived import of_report
    from rkfbench.errors import Different
    from rkfbench.judge import Verified, sentences, verified
    from rkfbench.pool import Pool
    from rkfbench.report.page import ScenarioView, write_report
    from rkfbench.reproduce import REFERENCE, RESULTS, compared_with_reference, finishing, publish, reference_study
    from rkfbench.scenario import bundled, load_bundled

    levels: dict[str, str] = {}
    judged: dict[Path, list[Verified]] = {}
    ready: dict[str | Path, ScenarioView] = {}

    def look(scenario: Any, folder: Path, outcome: Any) -> None:
        levels[scenario.name] = compared_with_reference(folder, scenario.name)
        judged[folder] = verified(folder)
        if outcome.changed:  # so the report changes, too
            ready[folder] = ScenarioView.of(folder, RESULTS).ahead()

    with Pool(jobs) as pool:
        if scheduler is None and (fresh or any(not (RESULTS / name).exists() for name in bundled())):
            pool.start(*WORKING)
        loaded = list(map(load_bundled, bundled()))
        studies = [reference_study(each) if reference else (each, RESULTS / each.name) for each in loaded]
        in_turn = sorted(studies, key=lambda study: -finishing(study[0]))  # what comes last keeps nobody waiting
        outcomes = running.experiments(
            terminal,
            in_turn,
            pool,
            full=full or reference,
            fresh=fresh,
            jobs=jobs,
            scheduler=scheduler,
            then=None if reference else look,
        )
        pool.close()
        failed = any(outcome.failures for outcome in outcomes)
        folders = []
        of_folder = {outcome.folder: outcome for outcome in outcomes}
        for scenario, folder in studies:
            if of_folder[folder].failures:
                continue
            if reference:
                folders.append(publish(folder, REFERENCE / scenario.name))
            else:
                folders.append(folder)
                terminal.note(f"{scenario.name}: against results/reference: {levels[scenario.name]}")
        if folders:
            place = REFERENCE if reference else RESULTS  # the committed report stands beside its figures
            report = write_report(folders, place, of_report(folders), embedded=not reference, ready=ready)
            every = (each for folder in folders for each in judged.get(folder) or verified(folder))
            rows = [{"paper": paper, "reading": reading, "claims": text} for paper, reading, text in sentences(every)]
            terminal.records(rows, ["paper", "reading", "claims"])
            terminal.note(f"report: {', '.join(map(str, report))}")
    if failed:
        raise typer.Exit(1)
    if different := [name for name, level in levels.items() if level == "different"]:
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
        running.unmeasured(terminal, scenario)
    if terminal.json:
        terminal.object(verdicts)
    if wrong:
        raise typer.Exit(UsageError.exit_code)


def _check_apart(folders: Sequence[Path]) -> None:
    from rkfbench.errors import UsageError

    for folder in folders:
        if folders.count(folder) > 1:
            raise UsageError(f"several scenarios would write into {folder}: give each a name of its own")


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


claims.add_to(app)
look.add_to(app)
exchange.add_to(app)
inspect.add_to(app)
own.add_to(app)
