"""Whether what tables and figures name exists: metrics, filters, cases, readings, sweep columns; and what `names` gives
other names to. What claims name is looked up by `claims.plan`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase

from rkfbench.errors import Path, SpecError, did_you_mean
from rkfbench.own import short
from rkfbench.scenario.advice import not_measured
from rkfbench.scenario.display import NameUse, case_matches, names_used
from rkfbench.scenario.paper_schema import Paper
from rkfbench.scenario.scenario import Cell
from rkfbench.scenario.schema import ScenarioFile
from rkfbench.times import FORMS

COUNTED = ("lost", "failed")  # metrics that every study has
NOUNS = {"over": "swept parameter", "printed": "table in the paper's file", "claim": "claim in the paper's file"}


def unknown_names(
    file: ScenarioFile, cells: Sequence[Cell], columns: Sequence[str], paper: Paper | None
) -> Iterator[SpecError]:
    """The names that the file's tables and figures use and nothing has, and ids that stand twice, with their paths."""
    known = known_names(cells, columns)
    if paper is not None:
        known |= {"printed": list(paper.tables), "claim": [claim.id for claim in (*paper.claims, *file.claims)]}
    shown = [*known["metric"], *known["filter"], *columns, *(each for table in file.tables for each in table.metrics)]
    shown += dict.fromkeys(part for case in known["case"] for part in (case, *case.split(",")))
    for label in file.names:
        if label not in shown:
            message = f"no case, sweep column, filter or metric '{label}' here{did_you_mean(label, shown)}"
            yield SpecError(message, ("names", label))
    for section in ("tables", "figures", "claims"):
        seen: set[str] = set()
        for index, item in enumerate(getattr(file, section)):
            if item.id in seen:
                yield SpecError(f"the id '{item.id}' is used twice", (section, index, "id"))
            seen.add(item.id)
            for use in names_used(item) if section != "claims" else ():
                if use.kind in known and not _has(known, use):
                    noun = NOUNS.get(use.kind, use.kind)
                    advice = not_measured if use.kind == "metric" else did_you_mean
                    message = f"no {noun} '{use.name}' here{advice(use.name, known[use.kind])}"
                    yield SpecError(message, (section, index, *use.path))


def stem(reading: str) -> str:
    """How a reading is called in the names of files; "" for a reading that needs no name."""
    words = re.sub(r"[^\w-]+", "-", reading)
    return "" if words == "default" else words


def twins(file: ScenarioFile) -> Iterator[tuple[SpecError, Path]]:
    """The readings and switches that the names of files do not tell apart, each with its place."""
    first = next(iter(file.readings), "default")
    called: list[tuple[str, Path]] = [(name, ("readings", name)) for name in file.readings]
    called += [(f"{first}+{switch}", ("sensitivity", switch)) for switch in file.sensitivity]
    seen: dict[str, str] = {}
    for name, place in called:
        other = seen.setdefault(stem(name), name)
        if other != name:
            message = f"files cannot be called after both '{other}' and '{name}': only letters, digits, - and _ count"
            yield SpecError(message), place


def known_names(cells: Sequence[Cell], columns: Sequence[str]) -> dict[str, list[str]]:
    """Every name of each kind, in the order of the scenario."""
    filters = [each for cell in cells for each in cell.spec["filters"]]
    parameters = [f"{short(each['use'])}.{key}" for each in filters if "use" in each for key in each if key != "use"]
    names = {
        "metric": [*(metric for cell in cells for metric in cell.spec["metrics"]), *COUNTED, *FORMS],
        "filter": [each["label"] for each in filters],
        "case": [cell.case for cell in cells],
        "reading": [cell.reading + (f"+{cell.switch}" if cell.switch else "") for cell in cells],
        "over": [*columns, *parameters],
    }
    return {kind: list(dict.fromkeys(each)) for kind, each in names.items()}


def _has(known: dict[str, list[str]], use: NameUse) -> bool:
    if use.kind == "case":
        return any(case_matches(use.name, case) for case in known["case"])
    if use.kind == "claim":  # {row} and {column} in an id stand for the labels of a table
        return any(fnmatchcase(use.name, re.sub(r"\{\w+\}", "*", each)) for each in known["claim"])
    return use.name in known[use.kind]
