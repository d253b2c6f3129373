"""The scenarios and paper files that come with the package, and what a name or path on the command line means.

In a checkout they stand in `scenarios/` beside the package; a wheel carries them as `rkfbench/_scenarios`.
"""

from __future__ import annotations

import os
from pathlib import Path

from rkfbench.errors import UsageError, did_you_mean

_INSTALLED = Path(__file__).parents[1] / "_scenarios"
FOLDER = _INSTALLED if _INSTALLED.is_dir() else Path(__file__).parents[2] / "scenarios"


def bundled() -> dict[str, Path]:
    """The bundled scenarios by name."""
    return {path.stem: path for path in sorted(FOLDER.glob("*.yaml"))}


def papers() -> dict[str, Path]:
    """The bundled paper files by name."""
    return {path.stem: path for path in sorted((FOLDER / "papers").glob("*.yaml"))}


def find(source: str | Path, known: dict[str, Path], what: str) -> Path:
    """The file that `source` means: a path, or one of the known names."""
    if str(source) in known:
        return known[str(source)]
    path = Path(source)
    if os.path.exists(path) or path.suffix in (".yaml", ".yml") or len(path.parts) > 1:
        return path
    raise UsageError(f"no {what} '{source}', neither a file nor a bundled one{did_you_mean(source, known)}")


def display(path: Path) -> str:
    """The path as messages show it: seen from the current directory when it is inside."""
    full, here = path.absolute(), Path.cwd()
    return full.relative_to(here).as_posix() if full.is_relative_to(here) else str(path)
