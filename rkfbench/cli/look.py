"""The commands that show what is there: list, show, schema, compare."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rkfbench.cli.common import command
from rkfbench.cli.terminal import Terminal

if TYPE_CHECKING:
    from rkfbench.compare.pair import Difference

# kind -> (module, name of its catalogue)
CATALOGUES = {
    "filters": ("rkfbench.filters", "FILTERS"),
    "moments": ("rkfbench.filters", "MOMENTS"),
    "weights": ("rkfbench.filters", "WEIGHTS"),
    "schemes": ("rkfbench.filters", "SCHEMES"),
    "models": ("rkfbench.models", "MODELS"),
    "truths": ("rkfbench.models.truths", "TRUTHS"),
    "noises": ("rkfbench.noise", "LAWS"),
    "disturbances": ("rkfbench.noise.disturbances", "DISTURBANCES"),
    "metrics": ("rkfbench.metrics", "METRICS"),
}

# what a difference is about -> how that is called
KINDS = {"row": "rows of summary.csv", "curve": "curves of series.csv", "check": "checks"}
EXTRA = " (extras and switches: it alone was run with --full)"

Kind = StrEnum("Kind", [(kind, kind) for kind in (*CATALOGUES, "scenarios")])  # type: ignore[misc]


def add_to(app: typer.Typer) -> None:
    """Add the commands of this file."""
    app.command("list")(list_)
    app.command()(show)
    app.command()(schema)
    app.command()(compare)


@command
def list_(terminal: Terminal, kind: Annotated[Kind, typer.Argument(help="What to list.")]) -> None:
    """List what a scenario can name, or the bundled scenarios."""
    if kind == "scenarios":
        from rkfbench.scenario import bundled, load

        scenarios = [load(name) for name in bundled()]
        rows = [{"name": each.name, "paper": each.paper or "", "summary": each.title} for each in scenarios]
        terminal.records(rows, ["name", "paper", "summary"])
        return
    rows = [
        {"name": name, "paper": entry.paper, "equations": entry.equations, "summary": entry.summary}
        for name, entry in _catalogue(kind).items()
    ]
    terminal.records(rows, ["name", "paper", "equations", "summary"])


@command
def show(terminal: Terminal, name: Annotated[str, typer.Argument(help="Any name that list prints.")]) -> None:
    """Show what a name stands for: its parameters, paper and equations; of a scenario, all of it with defaults.

    Below a scenario stands what else has its name, such as a model, as comments.
    """
    from rkfbench.errors import UsageError, did_you_mean
    from rkfbench.scenario import bundled, load
    from rkfbench.scenario.yaml import dump

    entries = {kind: catalogue[name] for kind in CATALOGUES if name in (catalogue := _catalogue(kind))}
    pages = [_page(name, kind, entry) for kind, entry in entries.items()]
    text = "\n".join(_text(page) for page in pages)
    if name in bundled() or (not entries and ("." in name or "/" in name)):
        resolved = load(name).resolved
        if terminal.json:
            terminal.object([resolved, *pages] if pages else resolved)
        else:
            terminal.data(dump(resolved) + indent(f"\n{text}" if text else "", "# ", lambda line: bool(line.strip())))
    elif pages:
        if terminal.json:
            terminal.object(pages)
        else:
            terminal.data(text)
    else:
        known = [*bundled(), *(each for kind in CATALOGUES for each in _catalogue(kind))]
        raise UsageError(f"nothing is called '{name}'{did_you_mean(name, known)}")


@command
def schema(terminal: Terminal) -> None:
    """Print the JSON Schema of scenario files, for editors."""
    from rkfbench.scenario.json_schema import schema as json_schema

    terminal.object(json_schema())


@command
def compare(
    terminal: Terminal,
    a: Annotated[Path, typer.Argument(help="A results folder.")],
    b: Annotated[Path, typer.Argument(help="Another one.")],
) -> None:
    """Compare two results folders: same bytes, same numbers, or a statistical difference (exit code 3).

    What only one of them has counts as a difference, unless that one alone was run with --full.
    """
    from rkfbench.compare import compare as compared
    from rkfbench.errors import Different, UsageError
    from rkfbench.store import Results

    first, second = Results.open(a), Results.open(b)
    found = compared(first, second)
    if not found.rows:
        raise UsageError(
            f"{a} ({first.scenario}) and {b} ({second.scenario}) are different experiments: no case, filter and "
            "metric is in both"
        )
    rows = [each.as_row() for each in found.differences]
    more = [each.as_row() for each in found.more]
    if terminal.json:
        head = {"level": found.level, "rows": found.rows, "threshold": found.threshold}
        terminal.object({**head, "differences": rows, "more": more})
    else:
        terminal.data(f"{found.level} ({found.rows} rows of summary.csv)")
        for text in (*_alone(found.differences, a, b), *_alone(found.more, a, b, EXTRA)):
            terminal.data(text)
        if both := [each.as_row() for each in found.differences if not each.only]:
            terminal.records(both, ["reading", "case", "filter", "metric", "a", "b", "z"])
    if found.level == "different":
        raise Different(f"{a} and {b} differ in {len(rows)} rows")


def _alone(differences: Sequence[Difference], a: Path, b: Path, why: str = "") -> Iterator[str]:
    """What only one of two folders has: one line a kind, since there may be thousands of each."""
    counted = Counter((KINDS[each.what], each.only) for each in differences if each.only)
    for (kind, side), count in counted.items():
        yield f"only in {a if side == 'a' else b}: {count} {kind}{why}"


def _catalogue(kind: str) -> dict[str, Any]:
    from importlib import import_module

    from rkfbench.catalogue import find
    from rkfbench.own.names import entry_points

    module, name = CATALOGUES[kind]
    catalogue: dict[str, Any] = getattr(import_module(module), name)
    group = getattr(catalogue, "group", None)
    installed = {each: find(catalogue, each) for each in (entry_points(group) if group else ())}
    return {**catalogue, **{each: entry for each, entry in installed.items() if entry}}


def _page(name: str, kind: str, entry: Any) -> dict[str, Any]:
    import inspect

    from rkfbench.catalogue import parameters

    return {
        "name": name,
        "kind": kind.removesuffix("s"),
        "paper": entry.paper,
        "equations": entry.equations,
        "needs": sorted(entry.needs),
        "text": inspect.getdoc(entry.make) or "",
        "parameters": [
            {"name": each.name, "default": "required" if each.required else each.default, "meaning": each.doc}
            for each in parameters(entry.make).values()
        ],
    }


def _text(page: dict[str, Any]) -> str:
    source = ", ".join(part for part in (page["paper"], page["equations"]) if part)
    lines = [f"{page['name']} ({page['kind']}{'; ' + source if source else ''})", "", page["text"], ""]
    if page["needs"]:
        lines += [f"Knows more than the measurements: {', '.join(page['needs'])}.", ""]
    for each in page["parameters"]:
        lines.append(f"  {each['name']} = {each['default']}: {each['meaning']}")
    return "\n".join(lines).rstrip() + "\n"
