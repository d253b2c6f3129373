"""The CSV files that a scenario names: recorded data in place of a simulation, and estimates of filters written
elsewhere.

    data: {measurements: drive.csv, truth: drive-truth.csv, time: t}
    filters: [kf, {use: estimates, file: mine.csv, label: mine}]

A path is seen from the folder of the scenario file. In the scenario that a results folder keeps, it leads to a copy
beside it, so that the folder can be run again wherever it is.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rkfbench.errors import SpecError, did_you_mean, nearest
from rkfbench.scenario.override import graft
from rkfbench.scenario.scenario import Cell
from rkfbench.scenario.schema import Experiment
from rkfbench.scenario.yaml import Map, Mark, Seq, marked

FILES = ("measurements", "truth")  # keys of `data` that name files
SIMULATED = ("steps", "start", "measurement_noise")  # what an experiment cannot do without, unless it has data
ESTIMATES = "estimates"  # the filter that reads what another program wrote
COPIES = "data"  # the folder of the copies in a results folder


def absolute(document: Map, folder: Path) -> Map:
    """The document with the paths of its files made absolute; `folder` is that of the scenario file."""
    changed: Map = _mapped(document, lambda path: str((folder / path).absolute()))
    return changed


def carried(resolved: Any, folder: Path) -> Any:
    """A resolved scenario whose files stand in a folder of copies beside it; copies them into the results `folder`."""
    places: dict[str, Path] = {}

    def copy(path: str) -> str:
        if path not in places:
            source = Path(path)
            taken = {each.name for each in places.values()}
            name = next(each for each in _names(source) if each not in taken)
            places[path] = folder / COPIES / name
            if source.absolute() != places[path].absolute():
                places[path].parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(source, places[path])
        return f"{COPIES}/{places[path].name}"

    return _mapped(resolved, copy)


def _names(path: Path) -> Iterator[str]:
    yield path.name
    yield from (f"{path.stem}-{i}{path.suffix}" for i in range(2, 10_000))


def _mapped(node: Any, change: Callable[[str], str], inside: str = "") -> Any:
    """The document with `change` applied to every path of a file; `inside` is the key under which `node` stands."""
    if isinstance(node, str) and inside in {f"data.{key}" for key in FILES}:
        return change(node)
    if isinstance(node, Mapping):
        new: Any = node.copy()  # type: ignore[attr-defined]
        for key, value in node.items():
            if (inside == "data" and key in FILES) or (key == "file" and node.get("use") == ESTIMATES):
                new[key] = change(value) if isinstance(value, str) else value
            else:  # the values of a sweep or override of data.truth are paths themselves
                new[key] = _mapped(value, change, inside if inside.startswith("data.") else key)
        return new
    if isinstance(node, list):
        new = node.copy()
        new[:] = [_mapped(each, change, inside) for each in node]
        return new
    return node


def with_steps(spec: Map) -> Map:
    """The cell with as many steps as its recording, where it does not say how many. SpecError if there is no file."""
    data = spec.get("data")
    if not isinstance(data, Map):
        return spec
    for key in FILES:
        if isinstance(path := data.get(key), str) and not Path(path).is_file():
            raise SpecError(f"there is no file {path}", ("data", key))
    if spec.get("steps") is not None or not isinstance(data.get("measurements"), str):
        return spec
    from rkfbench import recording

    return graft(spec, "steps", recording.size(data)[1], spec.mark)


def faults(spec: Map) -> Iterator[SpecError]:
    """What a cell must have because it is simulated, and what it must not have because it is not."""
    if spec.get("data") is None:
        unknown = [key for key in spec if key not in Experiment.model_fields]
        for key in SIMULATED:
            if spec.get(key) is None and not nearest(key, unknown):
                yield SpecError("is required", (key,))
        return
    for key in ("start", "truth", "disturbances"):
        if spec.get(key) not in (None, [], "model"):
            yield SpecError("is for a simulation, and with `data` there is none", (key,))


def recorded_runs(cells: Sequence[Cell]) -> int | None:
    """How many recordings there are: the fewest of any cell; None where all is simulated."""
    from rkfbench import recording

    counts = [recording.size(cell.spec["data"])[0] for cell in cells if cell.spec.get("data")]
    return min(counts) if counts else None


def placed(cells: Sequence[Cell], runs: int) -> list[Cell]:
    """The cells with their estimates: each filter that reads a file is told which rows are its own, and left out where
    the file says nothing of the cell.

    Rows without a reading are about the first one. Raises ScenarioError with the place in a file of everything wrong.
    """
    entries = [each for cell in cells for each in cell.spec["filters"] if each.get("use") == ESTIMATES]
    groups = {file: _groups(file, cells, runs) for file in dict.fromkeys(each["file"] for each in entries)}
    if not groups:
        return [*cells]
    return [replace(cell, spec={**cell.spec, "filters": list(_own(cell, groups))}) for cell in cells]


def _own(cell: Cell, groups: Mapping[str, Collection[tuple[str, str]]]) -> Iterator[Any]:
    for each in cell.spec["filters"]:
        if each.get("use") != ESTIMATES:
            yield each
        elif cell.switch is None and (cell.reading, cell.case) in groups[each["file"]]:
            yield {**each, "reading": cell.reading, "case": cell.case}


def _groups(file: str, cells: Sequence[Cell], runs: int) -> list[tuple[str, str]]:
    """The cells (reading, case) that a file of estimates is about; all its rows are looked at."""
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
    return found


def with_estimates(document: Map, estimates: Mapping[str, Path]) -> Map:
    """The document with one more filter for each label and file of estimates, shown in all its tables and figures."""
    for label, file in estimates.items():
        at = Mark(f"--label {label}")
        entry = marked({"use": ESTIMATES, "file": str(file.absolute()), "label": label}, at)
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
