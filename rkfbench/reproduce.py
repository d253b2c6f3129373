"""One experiment from its scenario to its report: study, ledger, tables, figures, sealed folder.

`rkfbench run` and `rkfbench reproduce` do this for each scenario; `publish` makes the committed form of a folder.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rkfbench import derived, own
from rkfbench.aside import Aside
from rkfbench.claims.estimand import Estimand, Selected
from rkfbench.compare import compare
from rkfbench.errors import UsageError
from rkfbench.judge import Docket, dockets
from rkfbench.pool import Pool
from rkfbench.scenario import bundled
from rkfbench.store import Results, files, manifest
from rkfbench.store.results import read_once
from rkfbench.study import checks, clock, plan, run, tuning
from rkfbench.study.engines import Engine, in_order
from rkfbench.study.events import Report
from rkfbench.study.missing import foreseen
from rkfbench.study.run import Outcome

if TYPE_CHECKING:
    from rkfbench.claims.forms import Form
    from rkfbench.scenario import Cell, Scenario
    from rkfbench.study.jobs import Job
    from rkfbench.study.precision import Goal
    from rkfbench.study.shards import Shard

RESULTS = Path("results")
REFERENCE = RESULTS / "reference"
CELLS = 100  # of claims, measured and judged while two processes draw a figure, about


def folder_of(scenario: Scenario, overrides: Sequence[str]) -> Path:
    """results/<scenario>, or results/<scenario>~<label> when options change what the scenario says."""
    if not overrides:
        return RESULTS / scenario.name
    return RESULTS / f"{scenario.name}~{files.slug(','.join(overrides))}"


def experiment(
    scenario: Scenario,
    folder: Path,
    *,
    full: bool = False,
    fresh: bool = False,
    engine: Engine,
    pool: Pool,
    aside: Aside,
    report: Report,
    argv: Sequence[str],
    goal: Goal | None = None,
    times: clock.Times | None = None,
    done: Callable[[Outcome], None],
) -> Outcome:
    """Bring a results folder up to date: its blocks now; `aside` the tables, `times` and what is made of them, and what
    is to be `done` with the outcome then.

    Returns what is known before the tables are there.
    """
    scenario, forms, choices = _measured(scenario, full)
    facts = {"argv": list(argv), "source": _source(scenario, folder)}
    with ExitStack() as held:
        held.enter_context(run.reserved(folder, scenario.name))
        computed = run.compute(
            scenario, folder, full=full, fresh=fresh, engine=engine, report=report, facts=facts, goal=goal
        )
        scenario, failures = replace(scenario, runs=computed.scenario.runs), computed.failures
        if choices and not failures:
            failures = tuning.update(scenario, choices, folder, fresh=fresh, engine=engine, report=report).failures
        lock = held.pop_all()

        def finish() -> None:
            with read_once(folder):
                with lock:
                    outcome = replace(computed.write(), failures=failures)
                    tuning.tie(folder, bool(choices) and not failures)
                    if times is not None:
                        clock.write(times, folder)
                    checks.update(scenario.paper or "", {form.check for form in forms} - {""}, folder, fresh=fresh)
                    derived.update(scenario, folder, pool, fresh=fresh)  # of what did not fail, if something did
                done(outcome)

        aside(finish)
    return replace(computed.outcome(), failures=failures)


def _source(scenario: Scenario, folder: Path) -> str | None:
    """Where the file of a scenario is, seen from its results folder; None for a bundled one, which is known by name."""
    file = os.path.realpath(scenario.file)
    known = bundled().get(scenario.name)
    if known is not None and file == os.path.realpath(known):
        return None
    return os.path.relpath(file, os.path.realpath(folder))


def jobs_ahead(
    scenario: Scenario, folder: Path, pool: Pool, *, full: bool = False, fresh: bool = False
) -> Iterator[Job]:
    """The jobs with which `experiment` will begin, as its folder lets expect."""
    scenario, _, _ = _measured(scenario, full)
    return in_order(foreseen(list(plan.units(scenario, folder, full)), scenario, fresh), pool)


def finishing(scenario: Scenario) -> float:
    """How long it takes to judge the claims of a study and to draw its figures, in figures, about."""
    cells = [cell for docket in dockets(scenario) for cell in docket.cells if cell.form.scenario == scenario.name]
    return len(scenario.figures) + len(cells) / CELLS


def times_of(scenario: Scenario, folder: Path, *, full: bool = False, fresh: bool = False) -> clock.Times | None:
    """The computing times that `experiment` is to write; None when the folder has them. Raises what filters raise."""
    scenario, forms, _ = _measured(scenario, full)
    wanted = clock.wanted(scenario, [form.estimand for form in forms if form.estimand is not None])
    with run.reserved(folder, scenario.name):
        return clock.measured(scenario, wanted, folder, full=full, fresh=fresh)


def shard_of_experiment(
    scenario: Scenario, folder: Path, shard: Shard, *, full: bool = False, engine: Engine, report: Report
) -> Outcome:
    """One shard of the blocks of `experiment`, tuning runs included; a plain experiment makes the rest of them."""
    scenario, _, choices = _measured(scenario, full)
    outcome = run.compute_shard(scenario, folder, shard, full=full, engine=engine, report=report)
    if not choices or outcome.failures:
        return outcome
    study = tuning.study_of(scenario, choices)
    tuned = run.compute_shard(study, folder / manifest.TUNING, shard, full=True, engine=engine, report=report)
    return replace(
        outcome,
        computed=outcome.computed + tuned.computed,
        reused=outcome.reused + tuned.reused,
        failures=tuned.failures,
        seconds=outcome.seconds + tuned.seconds,
        open=outcome.open + tuned.open,
    )


def _measured(scenario: Scenario, full: bool) -> tuple[Scenario, list[Form], set[tuning.Choice]]:
    """The scenario with the sensitivity cells that are run, the forms of its claims, and what is chosen by tuning.

    From now on its plug-ins are looked for: claims and keys ask for its metrics.
    """
    own.beside(scenario.plugins)
    claims = dockets(scenario)  # a claim that cannot be measured is an error before anything is run
    scenario = replace(scenario, sensitivity=tuple(_sensitive(scenario, claims)))
    forms = [cell.form for docket in claims for cell in docket.cells if cell.form.scenario == scenario.name]
    selections = _selections(form.estimand for form in forms if form.estimand is not None)
    return scenario, forms, {tuning.Choice(each.candidates, each.metric) for each in selections} if full else set()


def _sensitive(scenario: Scenario, claims: Sequence[Docket]) -> Iterator[Cell]:
    """The cells of the sensitivity study that headline claims are about; all of them where there is no headline."""
    headline = [cell for docket in claims for cell in docket.cells if cell.claim.id in docket.paper.headline]
    points = [point for cell in headline if cell.form.estimand for point in cell.form.estimand.points]
    cases = {case for point in points for case in point.case.names()}
    return (cell for cell in scenario.sensitivity if cell.case in cases or not headline)


def _selections(estimands: Iterable[Estimand]) -> Iterator[Selected]:
    """The choices of a best filter that claims make."""
    return (choice for estimand in estimands for _, choice in estimand.selected)


def reference_study(scenario: Scenario) -> tuple[Scenario, Path]:
    """The scenario at its reference run count, and the folder in which it is computed."""
    return replace(scenario, runs=scenario.reference_runs), RESULTS / f"{scenario.name}~reference"


def compared_with_reference(folder: Path, name: str) -> str:
    """On which level a folder agrees with the committed reference of the scenario `name`."""
    reference = REFERENCE / name
    if not reference.exists():
        return "there is none"
    return compare(Results.open(folder), Results.open(reference), common=True).level


def publish(folder: Path, reference: Path) -> Path:
    """Copy a results folder into the form that is committed: without numbers per run and blocks. Returns the copy.

    The reference that was there goes away last: whatever ends this early, it or the new one is whole, if under the name
    `.NAME.old`, from which the next call takes it back.
    """
    copy, old = (reference.with_name(f".{reference.name}.{what}") for what in ("copy", "old"))
    with files.writing(reference):
        if old.exists() and not reference.exists():
            old.rename(reference)
        for left in (copy, old):
            shutil.rmtree(left, ignore_errors=True)
        shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("runs.csv", manifest.BLOCKS, manifest.TUNING, ".*"))
        manifest.seal(copy)
        if reference.exists():
            reference.rename(old)
        copy.rename(reference)
        shutil.rmtree(old, ignore_errors=True)
    return reference


def folders_with_claims() -> list[Path]:
    """The folders below results/ that hold verdicts, or those of the reference when there are none."""
    for place in (RESULTS, REFERENCE):
        found = [path.parent for path in sorted(place.glob("[!.]*/claims.csv")) if "~" not in path.parent.name]
        if found:
            return found
    raise UsageError("there are no results yet: rkfbench reproduce makes them")
