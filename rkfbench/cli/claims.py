"""The commands about claims: verify, explain, report."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rkfbench.cli.common import command
from rkfbench.cli.terminal import Terminal

if TYPE_CHECKING:
    from rkfbench.claims.ledger import Row
    from rkfbench.claims.records import Change
    from rkfbench.judge import Verified
    from rkfbench.scenario import Scenario

Folders = Annotated[list[Path], typer.Argument(help="Results folders.")]


def add_to(app: typer.Typer) -> None:
    """Add the commands of this file."""
    for each in (verify, explain, report):
        app.command()(each)


@command
def verify(terminal: Terminal, folders: Folders) -> None:
    """Judge the claims as they stand now on the numbers of results folders.

    Exit code 3 when a verdict differs from the one in claims.csv, unless a clock decides it or it only stands beside.
    """
    from rkfbench.claims.records import record
    from rkfbench.errors import Different
    from rkfbench.judge import verified

    judged = []
    for folder in folders:
        judged += (found := verified(folder))
        if found:
            terminal.note(f"{folder}: judged as {found[0].scenario.file} says")
    rows = [row for each in judged for row in each.rows]
    changes = [change for each in judged for change in each.changes]
    if terminal.json:
        terminal.object([record(row) for row in rows])
    else:
        columns = ["claim", "reading", "verdict", "estimate", "lower", "upper", "claimed", "flips at", "estimand"]
        terminal.records([_line(row) for row in rows], columns)
        for text in _caveats(judged, rows):
            terminal.note(text)
    for change in changes:
        if not change.matters:
            terminal.note(f"{_told(change)} (no difference that counts)")
    if matter := [_told(change) for change in changes if change.matters]:
        raise Different("\n".join([*matter, f"{len(matter)} verdicts differ from claims.csv"]))


@command
def explain(
    terminal: Terminal,
    claim: Annotated[str, typer.Argument(help="The id of a claim, as the ledger shows it.")],
    folders: Annotated[list[Path], typer.Argument(help="Results folders (default: all below results/).")] = [],
) -> None:
    """Explain one claim: what the paper says, what was measured, its verdicts, and when they would flip."""
    from rkfbench.claims.records import record
    from rkfbench.claims.words import sentence
    from rkfbench.errors import UsageError, did_you_mean
    from rkfbench.judge import verified
    from rkfbench.reproduce import folders_with_claims

    judged = [each for folder in folders or folders_with_claims() for each in verified(folder)]
    found = [row for each in judged for row in each.rows]
    mine = [row for row in found if claim in (row.cell.id, row.cell.claim.id)]
    if not mine:
        known = dict.fromkeys(row.cell.id for row in found)
        raise UsageError(f"no results decide a claim '{claim}'{did_you_mean(claim, known)}")
    if terminal.json:
        terminal.object([record(row) for row in mine])
        return
    said = mine[0].cell.claim
    terminal.data(f"{claim}: {said.says}")
    terminal.data(f"{said.locator} (evidence: {said.evidence})" if said.locator else f"evidence: {said.evidence}")
    for text in _among(judged, claim):
        terminal.data(text)
    for row in mine:
        role = "" if row.cell.role == "decides" else "beside: "
        terminal.data(f"\n[{row.cell.reading}] {role}{sentence(row)}")
        terminal.data(f"  interval {_span(row)}, one of {row.family_size} judged together")
    for text in _caveats(judged, mine):
        terminal.data(f"\n{text}")
    of_mine = [each for each in judged if any(row in mine for row in each.rows)]
    for repeating in dict.fromkeys(_repeating(each, mine) for each in of_mine):
        terminal.data(f"\nrepeat with: {repeating}")


@command
def report(
    terminal: Terminal,
    folders: Folders,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the report (default: the first folder).")
    ] = None,
) -> None:
    """Make tables, figures and report again from results folders; runs no filter."""
    from contextlib import ExitStack

    from rkfbench.pool import Pool
    from rkfbench.report.page import NAMES, is_stamped, write_report
    from rkfbench.report.render import render
    from rkfbench.store import loose, manifest
    from rkfbench.store.lock import locked

    place = out or folders[0]
    for folder in folders:
        manifest.read(folder)  # only a results folder gets a lock
    ours = manifest.listed(place)
    loose.refuse_foreign(place, [name for name in NAMES if name not in ours and not is_stamped(place / name)], "report")
    written = [*folders, place] if manifest.is_sealed(place) else folders
    with ExitStack() as held:
        for folder in {folder.resolve(): folder for folder in written}.values():
            held.enter_context(locked(folder))
        with Pool() as pool:
            for folder in folders:
                render(folder, pool)
        paths = write_report(folders, place)
        if not manifest.is_sealed(place):
            loose.record(place, paths, "report")
    for path in paths:
        terminal.data(str(path))


def _repeating(judged: Verified, rows: Sequence[Row]) -> str:
    """The command that measures again those of the rows that were judged there."""
    from rkfbench.claims.needs import only_full

    full = any(only_full(row.cell, judged.scenario) for row in judged.rows if row in rows)
    return shlex.join(["rkfbench", "run", _source(judged.scenario), *(["--full"] if full else [])])


def _source(scenario: Scenario) -> str:
    """What `rkfbench run` takes to make the results of a scenario again: the name of a bundled one, or its file."""
    from rkfbench.scenario.files import bundled, display

    mine = bundled().get(scenario.name)
    return scenario.name if mine and display(mine) == scenario.file else scenario.file


def _told(change: Change) -> str:
    return f"{' '.join(change.key)}: {change.before or 'new'} -> {change.now or 'gone'}"


def _among(judged: Iterable[Verified], claim: str) -> Iterator[str]:
    """The verdict on a claim under each reading, and how many of its cells say so, where it has several."""
    from rkfbench.claims.words import among
    from rkfbench.judge import by_paper

    for _, _, verdicts in by_paper(judged):
        for each in verdicts:
            for reading, rows in each.rows.items():
                said = among([row.verdict for row in rows], each.claim.holds)
                own = reading in {row.cell.reading for row in rows}  # else the scenario has no such reading
                if said and own and claim in (each.id, each.claim.id):
                    yield f"[{reading}] {each.id} {each.verdicts[reading]}: {said}"


def _caveats(judged: Iterable[Verified], rows: Iterable[Row]) -> Iterator[str]:
    """What must be said of the readings under which these rows are shown."""
    shown = {(row.cell.form.scenario, row.cell.reading) for row in rows}
    for scenario in {each.scenario.name: each.scenario for each in judged}.values():
        for reading, text in scenario.caveats.items():
            if (scenario.name, reading) in shown:
                yield f"[{reading}] {text}"


def _line(row: Row) -> dict[str, Any]:
    measured = row.observed.measured if row.observed else None
    return {
        "claim": row.cell.id,
        "reading": row.cell.reading,
        "verdict": row.verdict if row.cell.role == "decides" else f"({row.verdict})",
        "estimate": measured.estimate if measured else None,
        "lower": row.judgement.lower if measured else None,
        "upper": row.judgement.upper if measured else None,
        "claimed": f"printed {row.cell.form.printed.value:g}" if row.cell.form.printed else str(row.region),
        "flips at": row.judgement.flip_at if measured else None,
        "estimand": row.cell.form.text,
    }


def _span(row: Row) -> str:
    return f"{row.judgement.lower + 0.0:.6g} .. {row.judgement.upper + 0.0:.6g}" if row.observed else "none"  # no -0
