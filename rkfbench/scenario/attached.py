"""The CSV files that a scenario names: recorded data in place of a simulation, and estimates of filters written
elsewhere.

    data: {measurements: drive.csv, truth: drive-truth.csv, time: t}
    filters: [kf, {use: estimates, file: mine.csv, label: mine}]

A path is seen from the folder of the scenario file. In the scenario that a results folder keeps, it leads to a copy
beside it, so that the folder can be run again wherever it is.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Any

from rkfbench.errors import SpecError, nearest
from rkfbench.scenario import estimates
from rkfbench.scenario.override import entry_name, graft
from rkfbench.scenario.scenario import Cell
from rkfbench.scenario.schema import Experiment
from rkfbench.scenario.yaml import Map, Seq

FILES = ("measurements", "truth")  # keys of `data` that name files
SIMULATED = ("steps", "start", "measurement_noise")  # what an experiment cannot do without, unless it has data
COPIES = "data"  # the folder of the copies in a results folder


def absolute(document: Map, folder: Path) -> Map:
    """The document with the paths of its files made absolute; `folder` is that of the scenario file."""
    changed: Map = _mapped(_labelled(document), lambda path: str((folder / path).absolute()))
    return changed


def _labelled(document: Map) -> Map:
    """The document with a label for each file that a sweep lists: its path as it is written."""
    sweep, reading = document.get("sweep"), _reading(document)
    if not isinstance(sweep, Map):
        return document
    new = document.copy()
    new["sweep"] = sweep.copy()
    for key, points in sweep.items():
        if _names_file(key, reading):
            new["sweep"][key] = _with_labels(points)
    return new


def _with_labels(points: Any) -> Any:
    if isinstance(points, Seq):
        named = Map(points.mark)
        for path, at in zip(points, points.values_at, strict=True):
            named.put(str(path), path, at, at)
        return named
    if isinstance(points, Map) and "values" in points:
        tiers = points.copy()
        tiers.update({key: _with_labels(each) for key, each in points.items()})
        return tiers
    return points


def carried(resolved: Mapping[str, Any]) -> tuple[Any, dict[str, str]]:
    """A resolved scenario whose files stand in a folder of copies beside it, and the file behind each copy, by name."""
    names: dict[str, str] = {}

    def copy(path: str) -> str:
        if path not in names:
            names[path] = next(each for each in _names(Path(path)) if each not in names.values())
        return f"{COPIES}/{names[path]}"

    changed = _mapped(resolved, copy)
    return changed, {name: path for path, name in names.items()}


def _names(path: Path) -> Iterator[str]:
    yield path.name
    yield from (f"{path.stem}-{i}{path.suffix}" for i in range(2, 10_000))


def _mapped(document: Mapping[str, Any], change: Callable[[str], str]) -> Any:
    """The document with `change` applied to every path of a file."""

    def file(params: Any) -> Any:
        new = params.copy()
        if isinstance(path := params.get("file"), str):
            new["file"] = change(path)
        return new

    return _of_data(estimates.changed(document, file), change, _reading(document))


def _reading(document: Mapping[str, Any]) -> Set[str | None]:
    """The filters that read a file, by the names under which overrides address them."""
    filters = document.get("filters")
    return {entry_name(each) for each in filters if estimates.within(each)} if isinstance(filters, list) else set()


def _of_data(node: Any, change: Callable[[str], str], reading: Set[str | None], inside: str = "") -> Any:
    """The same for the paths of `data`, and for those in overrides and sweeps; `inside` is the key under which `node`
    stands, `reading` are the filters that read a file.
    """
    if isinstance(node, str):
        return change(node) if _names_file(inside, reading) else node
    if isinstance(node, Mapping):
        new: Any = node.copy()  # type: ignore[attr-defined]
        for key, value in node.items():
            path = f"{inside}.{key}" if inside == "data" else key
            # the values of a sweep or override of data.truth are paths themselves
            new[key] = _of_data(value, change, reading, inside if _names_file(inside, reading) else path)
        return new
    if isinstance(node, list):
        new = node.copy()
        new[:] = [_of_data(each, change, reading, inside) for each in node]
        return new
    return node


def _names_file(key: str, reading: Set[str | None]) -> bool:
    """Whether what an override or a sweep has under `key` are paths: `data.truth`, `filters.mine.file`."""
    section, *inner = key.split(".")
    if section == "data":
        return len(inner) == 1 and inner[0] in FILES
    return section == "filters" and len(inner) > 1 and inner[0] in reading and inner[-1] == "file"


def pinned(spec: Mapping[str, Any]) -> dict[str, Any]:
    """The cell with the hash of each file of its recorded data, so that no other file is read in its place."""
    from rkfbench import sheet

    data = spec.get("data")
    if not data:
        return {**spec}
    return {**spec, "data": {**data, "sha256": {key: sheet.read(data[key]).sha256 for key in FILES if data.get(key)}}}


def hashes(cells: Sequence[Cell]) -> dict[str, str]:
    """The files that cells read, each with the hash of what they read in it."""
    found: dict[str, str] = {}
    for cell in cells:
        data = cell.spec.get("data") or {}
        found |= {data[key]: sha256 for key, sha256 in data.get("sha256", {}).items()}
        found |= {each["file"]: each["sha256"] for each in estimates.within(cell.spec["filters"])}
    return found


def with_steps(spec: Map) -> Map:
    """The cell with as many steps as its recording, where it does not say how many. SpecError if there is no file."""
    data = spec.get("data")
    if not isinstance(data, Map):
        return spec
    for key in FILES:
        if isinstance(path := data.get(key), str) and not os.path.isfile(path):
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
