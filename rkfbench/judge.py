"""Claims meet results: which claims a results folder decides, claims.csv, and judging stored measurements again.

A folder decides those cells of its paper's claims that are about its scenario, and the claims that the scenario itself
makes. The size of a family is that of the whole paper, whatever folders are there.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from itertools import chain
from pathlib import Path

from rkfbench import scenario as scenarios
from rkfbench.claims.checks import checks_of
from rkfbench.claims.ledger import ClaimVerdict, Row, claim_verdicts, ledger, under_switch
from rkfbench.claims.needs import why_not_run
from rkfbench.claims.plan import Cell, Outline, Outlines, faults, outline, own_paper, plan
from rkfbench.claims.records import COLUMNS, Change, record, stored, verify
from rkfbench.claims.words import markdown, summary
from rkfbench.errors import SpecError, UsageError
from rkfbench.scenario import Scenario
from rkfbench.scenario.files import papers
from rkfbench.scenario.paper_schema import Paper
from rkfbench.store import Results, files, manifest
from rkfbench.study.plan import EXPERIMENT, experiment

CLAIMS, PAGE = "claims.csv", "claims.md"


@dataclass(frozen=True)
class Docket:
    """The claims of one paper (or of one scenario's author) with all their cells, also those of other scenarios."""

    name: str
    paper: Paper
    cells: tuple[Cell, ...]
    outlines: Outlines


def write_claims(scenario: Scenario, folder: Path) -> list[Row]:
    """Measure and judge the claims that a results folder decides; writes claims.csv, claims.md and seals the folder."""
    results = Results.open(folder)
    rows: list[Row] = []
    pages = []
    for docket in dockets(scenario, results):
        every = ledger(docket.paper, docket.cells, {scenario.name: results}, docket.outlines)
        mine = [_noted(row, scenario, results) for row in every if row.cell.form.scenario == scenario.name]
        rows += mine
        title = f"Claims of {docket.name} that {scenario.name} decides"
        own = docket.outlines[scenario.name].readings
        verdicts = [each.under(own) for each in claim_verdicts(docket.paper, mine, docket.outlines)]
        said = (f"*{reading}*: {text}" if len(own) > 1 else text for reading, text in scenario.caveats.items())
        pages.append(markdown(title, verdicts, (scenario.title, scenario.notes, *said)))
    files.write_records(folder / CLAIMS, COLUMNS, map(record, rows))
    files.write(folder / PAGE, "\n".join(pages))
    manifest.seal(folder, CLAIMS, PAGE)
    return rows


@dataclass(frozen=True)
class Verified:
    """What a folder's stored measurements say about the claims of a docket, and where claims.csv said otherwise."""

    docket: Docket
    scenario: Scenario
    rows: list[Row]
    changes: list[Change]


def verified(folder: Path) -> list[Verified]:
    """The claims of the current scenario and paper files, judged on the measurements that a folder stores."""
    results = Results.open(folder)
    scenario = current(results)
    if CLAIMS not in results.manifest["files"]:
        raise UsageError(f"{folder} has no {CLAIMS}: make it with rkfbench run")
    kept = {line.key: line for line in map(stored, results.claims)}
    found = []
    for docket in dockets(scenario, results):
        cells = {cell.key for cell in docket.cells}
        mine = [kept.pop(key) for key in list(kept) if key in cells]
        rows, changes = verify(docket.paper, docket.cells, mine, docket.outlines)
        about = [_noted(row, scenario, results) for row in rows if row.cell.form.scenario == scenario.name]
        mine_changed = [change for change in changes if change.key[4] == scenario.name]
        found.append(Verified(docket, scenario, about, mine_changed))
    if found:
        found[0].changes.extend(Change(line.key, line.verdict, "", None) for line in kept.values())
    return found


def _noted(row: Row, scenario: Scenario, results: Results) -> Row:
    """The row with what its results say besides numbers: what a check found, why a cell was not run, and that the
    number of runs was found by looking at the numbers, which bends its interval.
    """
    exact = row.observed is not None and row.observed.measured.law == "exact"
    reasons = [row.judgement.reason, results.notes.get(row.cell.form.check, "")]
    if row.verdict == "not run":
        reasons.append(why_not_run(row.cell, scenario))
    if results.stopped and row.observed is not None and not exact and row.cell.family != "timing":
        reasons.append(f"runs not fixed beforehand: {results.stopped}")
    return replace(row, judgement=replace(row.judgement, reason="; ".join(filter(None, reasons))))


def sentences(judged: Iterable[Verified]) -> Iterator[tuple[str, str, str]]:
    """(paper, reading, what holds in one sentence, and its caveat) over all that was judged of each paper."""
    for name, parts, verdicts in by_paper(judged):
        for reading in dict.fromkeys(reading for each in verdicts for reading in each.verdicts):
            yield name, reading, ". ".join([summary(verdicts, reading), *caveats(parts, reading)])


def by_paper(judged: Iterable[Verified]) -> Iterator[tuple[str, list[Verified], tuple[ClaimVerdict, ...]]]:
    """(paper, what was judged of it, the verdicts on its claims over all of that)."""
    found: dict[str, list[Verified]] = {}
    for each in judged:
        found.setdefault(each.docket.name, []).append(each)
    for name, parts in found.items():
        docket = parts[0].docket
        yield name, parts, claim_verdicts(docket.paper, [row for part in parts for row in part.rows], docket.outlines)


def caveats(judged: Iterable[Verified], reading: str) -> list[str]:
    """What must be said where verdicts are shown under a reading, of every scenario that has it, or of its first."""
    shown = ((each.scenario, each.docket.outlines[each.scenario.name].shown(reading)) for each in judged)
    return list(dict.fromkeys(text for scenario, own in shown if (text := scenario.caveat(own))))


def current(results: Results) -> Scenario:
    """The scenario of a results folder as its file says now, bundled or the user's, as long as that describes the
    experiment that made the numbers; else the one that is stored.
    """
    source = results.manifest.get("source")
    file = (results.folder.resolve() / source).resolve() if source else scenarios.bundled().get(results.scenario)
    if file is not None and file.is_file():
        found = scenarios.load(file) if source else scenarios.load_bundled(results.scenario)
        if found.name == results.scenario and results.manifest["hashes"][EXPERIMENT] == experiment(found):
            return found
    return scenarios.load(results.folder / "scenario.yaml")


def dockets(scenario: Scenario, results: Results | None = None) -> list[Docket]:
    """The paper's claims and the scenario's own; with the headline claims under every switch that was run.

    ScenarioError when a claim asks for what its scenario does not have.
    """
    found = []
    if scenario.paper in papers():
        docket = _paper(scenario.paper)
        if scenario.name in docket.paper.scenarios:
            found.append(docket)
    if scenario.claims:
        own = own_paper(scenario.name, scenario.claims)
        outlines = {scenario.name: outline(scenario.cells, scenario.paper_runs, checks_of(scenario.paper or ""))}
        found.append(Docket(scenario.name, own, plan(own, outlines), outlines))
    return [_with_switches(docket, scenario.name, results) for docket in found]


def _with_switches(docket: Docket, scenario: str, results: Results | None) -> Docket:
    """The docket with its headline claims under every switch that was run."""
    first = docket.outlines[scenario].readings[0]
    run = dict.fromkeys(row["reading"] for row in results.summary) if results else {}
    switches = [reading for reading in run if reading.startswith(f"{first}+")]
    cells = (under_switch(docket.cells, docket.paper, scenario, first, switch) for switch in switches)
    return replace(docket, cells=(*docket.cells, *chain.from_iterable(cells)))


@cache
def _paper(name: str) -> Docket:
    """The claims of a bundled paper on all of its scenarios."""
    outlines: dict[str, Outline] = {}

    def found(paper: Paper) -> Iterator[SpecError]:
        bundled = scenarios.bundled()
        loaded = (scenarios.load_bundled(each) for each in paper.scenarios if each in bundled)
        outlines.update({each.name: outline(each.cells, each.paper_runs, checks_of(name)) for each in loaded})
        yield from faults(paper, outlines)

    paper = scenarios.load_paper(name, found)
    return Docket(name, paper, plan(paper, outlines), outlines)
