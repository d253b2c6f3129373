"""Experiments under the eyes of the user: progress while they run, what became of them when they have."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rkfbench.cli.terminal import Terminal

if TYPE_CHECKING:
    from rkfbench.pool import Pool

ASIDE = 2  # threads: while the figures of one study are drawn, the other makes tables and claims of the next
Studies = Sequence[tuple[Any, Path]]  # scenarios, each with its folder


def experiments(
    terminal: Terminal,
    studies: Studies,
    pool: Pool,
    *,
    full: bool,
    fresh: bool,
    jobs: int | None,
    scheduler: str | None = None,
    goals: Sequence[Any] = (),
    then: Callable[[Any, Path, Any], None] | None = None,
) -> list[Any]:
    """Experiments one after the other; what can be made later is made beside the next, `then(scenario, folder,
    outcome)` of the finished folder too. Clocks run before all else, while the pool is idle.
    """
    from rkfbench.aside import Aside
    from rkfbench.errors import RkfbenchError
    from rkfbench.own.faults import told
    from rkfbench.reproduce import experiment, jobs_ahead, times_of
    from rkfbench.study.engines import engine

    outcomes: list[Any] = [None] * len(studies)
    clocks: list[Any] = []
    pool.started()
    for scenario, folder in studies:
        clocks.append(None)
        with terminal.progress(scenario.name):
            try:
                clocks[-1] = times_of(scenario, folder, full=full, fresh=fresh)
            except RkfbenchError:
                raise
            except Exception as error:  # of a filter that somebody wrote; the study will tell which
                terminal.note(f"{scenario.name}: no computing times: {told(error)}")
    apart = _apart(studies)
    with Aside(ASIDE if pool.workers > 1 and apart else 0) as aside:
        how = engine(jobs, pool, scheduler)
        for i, (scenario, folder) in enumerate(studies):
            if i + 1 < len(studies) and apart and not any(goals):
                pool.foresee(partial(jobs_ahead, *studies[i + 1], pool, full=full, fresh=fresh))

            def done(outcome: Any, i: int = i, scenario: Any = scenario, folder: Path = folder) -> None:
                outcomes[i] = outcome
                if then is not None and not outcome.failures:
                    then(scenario, folder, outcome)

            with terminal.progress(scenario.name) as listen:
                so_far = experiment(
                    scenario,
                    folder,
                    full=full,
                    fresh=fresh,
                    engine=how,
                    pool=pool,
                    aside=aside,
                    report=listen,
                    argv=["rkfbench", *sys.argv[1:]],
                    goal=goals[i] if goals else None,
                    times=clocks[i],
                    done=done,
                )
            terminal.note(_summary(scenario.name, so_far))
    return outcomes


def unmeasured(terminal: Terminal, scenario: Any) -> None:
    """Which metrics a filter does not have."""
    from rkfbench.scenario.unmeasured import notes

    for each in notes(scenario):
        terminal.note(f"{scenario.name}: {each}")


def _apart(studies: Studies) -> bool:
    """Whether one study can be finished, or begun, while another runs: their plug-ins are looked for in one folder at a
    time.
    """
    cells = (cell for scenario, _ in studies for cell in (*scenario.cells, *scenario.sensitivity))
    return len(studies) == 1 or not any("plugins" in cell.spec for cell in cells)


def shards(
    terminal: Terminal, studies: Studies, text: str, *, full: bool, jobs: int | None, scheduler: str | None
) -> list[Any]:
    """One shard of each experiment, and what is still to be done; on one core unless told otherwise."""
    from rkfbench.pool import Pool
    from rkfbench.reproduce import shard_of_experiment
    from rkfbench.study.engines import engine
    from rkfbench.study.shards import Shard

    shard, outcomes = Shard.of(text), []
    with Pool(jobs or 1) as pool:
        how = engine(jobs or 1, pool, scheduler)
        for scenario, folder in studies:
            with terminal.progress(scenario.name) as listen:
                outcome = shard_of_experiment(scenario, folder, shard, full=full, engine=how, report=listen)
            done = f"{scenario.name}: shard {shard}: {outcome.computed} blocks computed, {outcome.reused} were there"
            left = (
                f"blocks of the study still to be computed by other shards: {outcome.open}; then"
                if outcome.open
                else "all blocks of the study are there:"
            )
            terminal.note(f"{done}; {left} the same command without --shard makes the tables")
            outcomes.append(outcome)
    return outcomes


def goal(terminal: Terminal, scenario: Any, precision: list[str], max_runs: int | None) -> Any:
    """What `--precision` asks of a scenario, if anything; said, as the metric may be the scenario's."""
    if not precision:
        return None
    from rkfbench import own
    from rkfbench.study.blocks import block_size
    from rkfbench.study.precision import Goal

    own.beside(scenario.plugins)
    found = Goal.of(precision, max_runs, scenario)
    size = max(block_size(cell.spec["steps"]) for cell in scenario.cells)
    blocks = f" in blocks of {size}" if size < found.most else ""
    terminal.note(f"{scenario.name}: precision {found} in every case, with at most {found.most} runs{blocks}")
    return found


def show(terminal: Terminal, outcomes: Sequence[Any]) -> None:
    """The results folders, or all that is known of the outcomes as data; exit code 1 when a filter raised."""
    if terminal.json:
        terminal.object([_as_data(outcome) for outcome in outcomes])
    else:
        for outcome in outcomes:
            terminal.data(str(outcome.folder))
    if any(outcome.failures for outcome in outcomes):
        raise typer.Exit(1)


def _summary(name: str, outcome: Any) -> str:
    if outcome.failures:
        failed = f"{len(outcome.failures)} failures, told above"
        return f"{name}: {failed}; results of all that worked are in {outcome.folder}"
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
