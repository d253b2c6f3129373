"""What may be written over and what may be taken away: only what rkfbench itself has written.

A results folder is recognised by its manifest, or, when a run was cut short or the manifest is damaged, by its blocks.
Of what is in it only files that the manifest lists are removed, and blocks. A folder that is a link to another place
stays one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from rkfbench.errors import UsageError
from rkfbench.store import files, manifest

OWNER = ".scenario"  # says whose the blocks are while there is no manifest
_BLOCK = re.compile(r".*~[0-9a-f]{6}\.\d{4,}\.block")  # as `study.plan` names them


def refuse_foreign(folder: Path, scenario: str) -> None:
    """Results go into a new or empty folder, or over results of the same scenario; UsageError for anything else."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise UsageError(f"{folder} is a file: choose another folder with --out")
    with files.writing(folder):
        entries = {path.name for path in folder.iterdir() if _holds_files(path)}
        unfinished = any(_blocks(folder)) or any(_blocks(folder / manifest.TUNING))
    owner = manifest.scenario(folder)
    if not entries or owner == scenario:
        return
    if owner and manifest.is_sealed(folder):
        raise UsageError(f"{folder} holds the results of '{owner}': choose another folder with --out")
    if unfinished and _owner(folder) not in ("", scenario):
        raise UsageError(f"{folder} holds blocks of '{_owner(folder)}': choose another folder with --out")
    ours = {*manifest.TOP, *manifest.FOLDERS, manifest.BLOCKS, manifest.TUNING}
    foreign = sorted(entries - ours - {manifest.NAME}) if unfinished else sorted(entries)
    if foreign:
        told = ", ".join(foreign[:3]) + (" ..." if len(foreign) > 3 else "")
        raise UsageError(f"{folder} holds other files ({told}): choose an empty folder, or a new one, with --out")


def mark(folder: Path, scenario: str) -> None:
    """Say whose the blocks are that will be written: shards, and runs that are cut short, leave no manifest."""
    if _owner(folder) != scenario:
        with files.writing(folder / OWNER):
            (folder / OWNER).write_text(scenario, encoding="utf-8")


def _owner(folder: Path) -> str:
    try:
        return (folder / OWNER).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""


def remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files of a results folder, and the folders in it that become empty."""
    for name in names:
        path = folder / name
        with files.writing(path):
            path.unlink(missing_ok=True)
            for above in path.parents:
                if above == folder or above.is_symlink() or not above.is_dir() or any(above.iterdir()):
                    break
                above.rmdir()


def remove_blocks(folder: Path) -> None:
    """Remove the finished blocks of a results folder, but not the folder in which they are."""
    with files.writing(folder / manifest.BLOCKS):
        for path in list(_blocks(folder)):
            path.unlink()


def _holds_files(path: Path) -> bool:
    """Whether it is a file, or a folder with one in it, that is not hidden."""
    every = [path] if path.is_file() else path.rglob("*")
    return not path.name.startswith(".") and any(not each.name.startswith(".") and not each.is_dir() for each in every)


def _blocks(folder: Path) -> Iterator[Path]:
    place = folder / manifest.BLOCKS
    if place.is_dir():
        yield from (path for path in place.iterdir() if _BLOCK.fullmatch(path.name))
