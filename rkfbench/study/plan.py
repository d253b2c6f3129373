"""The plan of a study: its units (case x block of runs), and which numbers of each are already in the folder.

A part, one filter in one unit, has a key: hashes of everything that its numbers are a function of. Numbers whose key is
the wanted one are reused; for others the first entry of the key that differs is the reason to tell.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rkfbench import metrics, own
from rkfbench.scenario import estimates
from rkfbench.store import blocks, manifest

if TYPE_CHECKING:
    from rkfbench.scenario import Cell, Scenario

Key = dict[str, Any]

EXPERIMENT = "experiment"  # the hash in the manifest that tells whether a scenario is the one of the numbers

# The compute part: every source file that a number of a block is made by. A test compares this with what is imported.
COMPUTE = (
    *(
        "blas.py",
        "catalogue.py",
        "experiment.py",
        "interrupts.py",
        "linalg.py",
        "own",
        "parts.py",
        "recorded.py",
        "recording.py",
        "sheet.py",
        "streams.py",
        "filters",
        "metrics",
        "models",
        "noise",
    ),
    *("store/blocks.py", "study/blocks.py", "study/compute.py", "study/jobs.py", "study/wide.py"),
)


@dataclass(frozen=True)
class Unit:
    """Runs `first` to `last` (exclusive) of one cell: the labels wanted of them, and the key of every filter's part."""

    cell: Cell
    block: int
    first: int
    last: int
    labels: tuple[str, ...]
    keys: Mapping[str, Key]
    path: Path


@dataclass(frozen=True)
class Stored:
    """What the folder holds of a unit: usable parts, and why the others of the wanted ones are not there."""

    usable: frozenset[str]
    missing: tuple[str, ...]
    reason: str = ""  # "" when nothing was there before


def name(cell: Cell) -> str:
    """How a cell is called in messages: `rate=0.2 (literal)`."""
    return f"{cell.case or 'the only case'} ({reading(cell)})"


def reading(cell: Cell) -> str:
    """How the reading of a cell is called in results: a switch of the sensitivity study is one more reading."""
    return cell.reading if cell.switch is None else f"{cell.reading}+{cell.switch}"


def cells(scenario: Scenario, full: bool) -> list[Cell]:
    """The cells to run: the first tier, or with `full` also extras and sensitivity."""
    first = [cell for cell in scenario.cells if full or not cell.extra]
    return first + (list(scenario.sensitivity) if full else [])


def labels(cell: Cell, full: bool) -> tuple[str, ...]:
    """The filters of a cell to run, by label, in the order of the scenario; a switch is shown without the extra
    ones.
    """
    extra = full and cell.switch is None
    return tuple(
        each["label"] for each in cell.spec["filters"] if (extra or not each.get("extra")) and not each.get("timing")
    )


def units(scenario: Scenario, folder: Path, full: bool) -> Iterator[Unit]:
    """All units of a study, case after case."""
    from rkfbench.study.blocks import block_size

    for cell in cells(scenario, full):
        size = block_size(cell.spec["steps"])
        keys = part_keys(cell.spec, scenario.seed)
        for block, first in enumerate(range(0, scenario.runs, size)):
            last = min(first + size, scenario.runs)
            with_runs = {label: {**key, "runs": [first, last]} for label, key in keys.items()}
            path = folder / manifest.BLOCKS / f"{_file_name(cell)}.{block:04d}.block"
            yield Unit(cell, block, first, last, labels(cell, full), with_runs, path)


def part_keys(spec: Mapping[str, Any], seed: int) -> dict[str, Key]:
    """For each filter of a cell the key of its numbers, but for the runs."""
    shared = {key: value for key, value in spec.items() if key not in ("filters", "metrics", "data", "plugins")}
    filters = {
        each["label"]: digest({k: v for k, v in _wherever(each).items() if k not in ("extra", "timing")})
        for each in spec["filters"]
    }
    partners = sorted({label for name in spec["metrics"] for label in metrics.get(name).quantity.partners})
    common = {
        "code": code_hash(),
        "seed": seed,
        "scenario": digest(shared),
        "metrics": digest([spec["metrics"], [filters.get(label) for label in partners]]),
    }
    if data := spec.get("data"):
        common["data"] = digest({key: value for key, value in {**data, **data["sha256"]}.items() if key != "sha256"})
    return {label: {**common, "filter": one, **_plugins(spec, {label, *partners})} for label, one in filters.items()}


def experiment(scenario: Scenario) -> str:
    """A hash of all that the numbers of a scenario depend on, but for the code, the seed and the number of runs."""
    found = []
    for cell in scenario.cells:
        keys = part_keys(cell.spec, seed=0)
        found.append([cell.reading, cell.case, {label: {**key, "code": ""} for label, key in keys.items()}])
    return digest(found)


def _plugins(spec: Mapping[str, Any], labels: Set[str]) -> Key:
    """The hashes of the plug-ins that numbers come from: those of the filters `labels`, and all that are no filters."""
    sources = spec.get("plugins", {}).get("sources")
    if not sources:
        return {}
    mine = [each for each in spec["filters"] if each["label"] in labels]
    named = set(own.texts({**spec, "filters": mine, "plugins": None}))
    found = {name: digest for name, digest in sources.items() if name in named}
    return {"plugins": found} if found else {}


def _wherever(filter: Mapping[str, Any]) -> dict[str, Any]:
    """A filter without the paths of files that it reads: their hashes are there, and where they stand is no matter."""
    changed: dict[str, Any] = estimates.changed(filter, lambda params: {k: v for k, v in params.items() if k != "file"})
    return changed


def look_up(unit: Unit) -> Stored:
    """Compare the block file of a unit with what is wanted."""
    try:
        found = blocks.keys(unit.path)
    except blocks.Damaged as error:
        return Stored(frozenset(), unit.labels, str(error))
    usable = frozenset(label for label, key in found.items() if key == unit.keys.get(label))
    missing = tuple(label for label in unit.labels if label not in usable)
    stale = [label for label in missing if label in found]
    if stale:
        reason = _difference(stale[0], found[stale[0]], unit.keys[stale[0]])
    else:
        reason = f"filter {', '.join(missing)} is not there yet" if found and missing else ""
    return Stored(usable, missing, reason)


def digest(data: Any) -> str:
    """A hash of plain data."""
    text = json.dumps(data, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_hash() -> str:
    """A hash of the sources of the compute part and of the versions of NumPy and SciPy, which together make the
    numbers.
    """
    from importlib.metadata import version

    root = Path(__file__).parents[1]
    sources = (root / name for name in COMPUTE)
    every = [file for path in sources for file in (sorted(path.rglob("*.py")) if path.is_dir() else [path])]
    return hash_files(root, every, version("numpy"), version("scipy"))


def hash_files(root: Path, sources: Sequence[Path], *more: str) -> str:
    """A hash of the names and contents of files, and of some texts."""
    total = hashlib.sha256("\n".join(more).encode())
    for path in sources:
        total.update(f"\n{path.relative_to(root).as_posix()}\n".encode())
        total.update(path.read_bytes())
    return total.hexdigest()[:16]


_REASONS = {
    "code": "code of the compute part changed",
    "seed": "seed changed",
    "runs": "number of runs changed",
    "scenario": "scenario changed",
    "metrics": "metrics changed",
    "data": "recorded data changed",
}


def _difference(label: str, old: Mapping[str, Any], new: Key) -> str:
    was = old.get("plugins", {})
    if changed := [name for name, digest in new.get("plugins", {}).items() if was.get(name, digest) != digest]:
        return f"source of {', '.join(changed)} changed"
    for entry, reason in _REASONS.items():
        if old.get(entry) != new.get(entry):
            return reason
    return f"filter {label} changed"


def _file_name(cell: Cell) -> str:
    """A file name that a reader recognises, with a hash that keeps any two cells apart."""
    words = re.sub(r"[^A-Za-z0-9.=]+", "-", f"{reading(cell)} {cell.case}").strip("-.")
    return f"{words[:80]}~{digest([reading(cell), cell.case])[:6]}"
