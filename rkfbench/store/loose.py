"""Files for a reader in a folder that holds no study: those of tune, trace, export and report.

A hidden record beside them says which files rkfbench wrote, with their hashes and what they are of. Nothing else is
ever written over: neither a file of somebody else's, nor one that was edited, nor the results of other options.
"""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

from rkfbench.errors import UsageError
from rkfbench.store import files

RECORD = ".rkfbench.json"


def refuse_foreign(folder: Path, names: Iterable[str], of: str) -> None:
    """UsageError unless files of these names, which are `of` something, may be written into the folder."""
    place = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not place.is_dir():
        raise UsageError(f"{place} is a file: choose a folder with --out")
    if not os.access(place, os.W_OK):
        raise UsageError(f"cannot write into {place}: choose another folder with --out")
    known = _read(folder)
    for name in names:
        path = folder / name
        if not (path.exists() or path.is_symlink()):
            continue
        if not _is_ours(path, known):
            raise UsageError(
                f"{path} was not written by rkfbench, or was edited since: move it, or choose another folder with --out"
            )
        if known[name]["of"] != of:
            raise UsageError(f"{path} is of other options ({known[name]['of']}): choose another folder with --out")


def record(folder: Path, paths: Iterable[Path], of: str) -> None:
    """Remember that rkfbench has written these files."""
    new = {path.name: {"sha256": files.sha256(path), "of": of} for path in paths}
    files.write(folder / RECORD, json.dumps(_read(folder) | new, indent=2) + "\n")


def remove_others(folder: Path, of: str, names: Collection[str]) -> list[str]:
    """Remove what was written before `of` the same and is not among `names`; what was edited since stays."""
    known = _read(folder)
    old = [name for name, each in known.items() if each["of"] == of and name not in names]
    gone = [name for name in old if _is_ours(folder / name, known)]
    for name in gone:
        (folder / name).unlink()
    return gone


def _is_ours(path: Path, known: dict[str, Any]) -> bool:
    return path.name in known and path.is_file() and files.sha256(path) == known[path.name]["sha256"]


def _read(folder: Path) -> dict[str, Any]:
    try:
        found = json.loads((folder / RECORD).read_text(encoding="utf-8"))
        return {name: {"sha256": str(each["sha256"]), "of": str(each["of"])} for name, each in found.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # none, or one that somebody edited
        return {}
