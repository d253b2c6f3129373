"""Estimates of filters written elsewhere, in the place of a filter or inside one: which rows of a file are about which
cell.

    {use: estimates, file: mine.csv, label: mine}
    {estimates: {file: mine.csv}, label: mine}                         the same
    {quantised: {filter: {use: estimates, file: mine.csv}, step: 1}, label: rounded}

A file says of its rows which case and which reading they are about; rows without a reading are about the first one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rkfbench.errors import did_you_mean
from rkfbench.scenario.override import graft
from rkfbench.scenario.scenario import Cell
from rkfbench.scenario.yaml import Map, Mark, Seq, marked

NAME = "estimates"  # the filter that reads what another program wrote
Params = Mapping[str, Any]


def changed(node: Any, change: Callable[[Any], Any]) -> Any:
    """The description of a filter, or a whole document, with `change` applied to the parameters of every `estimates`
    in it.
    """
    if isinstance(node, Mapping):
        if node.get("use") == NAME:
            return change(node)
        new: Any = node.copy()  # type: ignore[attr-defined]
        for key, value in node.items():
            short = key == NAME and "use" not in node and isinstance(value, Mapping) and "file" in value
            new[key] = change(value) if short else changed(value, change)
        return new
    if isinstance(node, list):
        new = node.copy()
        new[:] = [changed(each, change) for each in node]
        return new
    return node


def within(spec: Any) -> list[Params]:
    """The parameters of every `estimates` in the description of a filter, or of several."""
    found: list[Params] = []

    def note(params: Params) -> Params:
        found.append(params)
        return params

    changed(spec, note)
    return found


def placed(cells: Sequence[Cell], runs: int) -> list[Cell]:
    """The cells with their estimates: each filter that reads a file is told which rows are its own, and left out where
    the file says nothing of the cell.

    Rows without a reading are about the first one. Raises ScenarioError with the place in a file of everything wrong.
    """
    read = dict.fromkeys(each["file"] for cell in cells for each in within(cell.spec["filters"]))
    groups = {file: _groups(file, cells, runs) for file in read}
    if not groups:
        return [*cells]
    return [replace(cell, spec={**cell.spec, "filters": list(_own(cell, groups))}) for cell in cells]


def _own(cell: Cell, groups: Mapping[str, tuple[str, Collection[tuple[str, str]]]]) -> Iterator[Any]:
    def told(params: Params) -> Params:
        return {**params, "reading": cell.reading, "case": cell.case, "sha256": groups[params["file"]][0]}

    for each in cell.spec["filters"]:
        about = [groups[params["file"]][1] for params in within(each)]
        if not about or (cell.switch is None and all((cell.reading, cell.case) in cells for cells in about)):
            yield changed(each, told)


def _groups(file: str, cells: Sequence[Cell], runs: int) -> tuple[str, list[tuple[str, str]]]:
    """The hash of a file of estimates, and the cells (reading, case) that it is about; all its rows are looked at."""
    from rkfbench import models, sheet
    from rkfbench.filters.estimates import PLACE, cells_of, table

    page = sheet.read(file)
    there = [cell for cell in cells if cell.switch is None]
    known = {key: list(dict.fromkeys(getattr(cell, key) for cell in there)) for key in PLACE}
    given = [key for key in PLACE if key in page.columns]
    if "case" not in given and len(known["case"]) > 1:
        raise sheet.told([page.fault(f"no column 'case', and the scenario has {', '.join(known['case'])}")])
    found = []
    for key, (row, count) in cells_of(page).items():
        place = {name: names[0] for name, names in known.items()} | dict(zip(given, key, strict=True))
        for name in given:
            if place[name] not in known[name]:
                message = f"no {name} '{place[name]}' in the scenario{did_you_mean(place[name], known[name])}"
                raise sheet.told([page.fault(message, row, name)])
        if count < runs:
            raise sheet.told([page.fault(f"{count} runs here, the study has {runs}: add --runs {count}", row, "run")])
        cell = next(each for each in there if (each.reading, each.case) == (place["reading"], place["case"]))
        table(page, place, models.build(cell.spec["model"]).states, cell.spec["steps"])
        found.append((cell.reading, cell.case))
    return page.sha256, found


def with_estimates(document: Map, estimates: Mapping[str, Path]) -> Map:
    """The document with one more filter for each label and file of estimates, shown in all its tables and figures."""
    for label, file in estimates.items():
        at = Mark(f"--label {label}")
        entry = marked({"use": NAME, "file": str(file.absolute()), "label": label}, at)
        document = _added(document, "filters", entry, at)
        for section in ("tables", "figures"):
            if isinstance(shown := document.get(section), Seq):
                new = shown.copy()
                new[:] = [_added(each, "filters", label, at) if isinstance(each, Map) else each for each in shown]
                document = graft(document, section, new, document.values_at[section])
    return document


def _added(node: Map, key: str, value: Any, at: Mark) -> Map:
    """`node` with one more entry in the list at `key`, where there is one."""
    if not isinstance(listed := node.get(key), Seq):
        return node
    longer = listed.copy()
    longer.add(value, at)
    new = node.copy()
    new.put(key, longer, node.keys_at[key], node.values_at[key])
    return new
