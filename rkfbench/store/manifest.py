"""The manifest of a results folder: what made it, and the hash of each of its files.

A folder is sealed when its manifest lists every file that rkfbench wrote with its SHA-256, and holds its own. Sealing
again without a change of any file leaves the manifest as it is, so that its times say when the numbers were made. What
somebody else has put into the folder is never listed, and so never judged, made again or removed.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from rkfbench.errors import UsageError
from rkfbench.store import files

SCHEMA = 1
NAME = "manifest.json"
OWN = "sha256"  # the entry with the manifest's own hash
BLOCKS = "blocks"
TUNING = "tuning"  # a results folder of its own inside another one

# All that rkfbench writes into a results folder, beside its manifest, blocks and tuning runs.
TOP = (
    *("scenario.yaml", "filters.csv", "summary.csv", "series.csv", "runs.csv", "checks.csv"),
    *("claims.csv", "claims.md", "report.md", "report.html"),
)
FOLDERS = ("data", "figures", "plugins", "tables", "timings")


def seal(folder: Path, *written: str, **facts: Any) -> bool:
    """Write the manifest with `facts` (kept from before where not given); False when no file had changed.

    It lists the files `written` since, and those that it listed before and that are still there. `hashes` among the
    facts, of what parts of the folder were made from, are added to those that are there.
    """
    old = _readable(folder)
    names = sorted({*_listed(old), *written})
    listed = {name: files.sha256(folder / name) for name in names if (folder / name).is_file()}
    hashes = {**old.get("hashes", {}), **facts.get("hashes", {})}
    if (old.get("files"), old.get("hashes", {})) == (listed, hashes):
        return False
    kept = {key: value for key, value in old.items() if key not in ("schema", "files", "hashes")}
    content = {"schema": SCHEMA, **kept, **facts, "hashes": hashes, "files": listed}
    files.write(folder / NAME, json.dumps({**content, OWN: _own(content)}, indent=2) + "\n")
    return True


def read(folder: Path) -> dict[str, Any]:
    """The manifest of a results folder; UsageError that says what to do when there is none that can be used."""
    path = folder / NAME
    if not folder.is_dir():
        raise UsageError(f"{folder}: no such results folder")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UsageError(f"{folder} is not a results folder: it has no {NAME} (make one with rkfbench run)") from None
    except OSError as error:
        raise UsageError(f"cannot read {path}: {error.strerror}") from error
    except ValueError as error:
        raise UsageError(f"{path} is damaged: {_REPAIR}") from error
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != SCHEMA:
        raise UsageError(f"{path} has schema version {schema}, this rkfbench reads {SCHEMA}: {_REPAIR}")
    own = content.pop(OWN, None)
    if not isinstance(content.get("files"), dict) or own != _own(content):
        raise UsageError(f"{path} is not what rkfbench wrote (edited or damaged): {_REPAIR}")
    return content


def verify(folder: Path, content: Mapping[str, Any]) -> None:
    """Compare the data files of a folder (not its figures and pages) with the manifest; UsageError on the first lie."""
    for name, digest in _data(content).items():
        path = folder / name
        try:
            found = files.sha256(path)
        except FileNotFoundError:
            raise UsageError(f"{path} is missing: {_REPAIR}") from None
        except OSError as error:
            raise UsageError(f"cannot read {path}: {error.strerror}") from error
        if found != digest:
            raise UsageError(f"{path} is not what rkfbench wrote (edited or damaged): {_REPAIR}")


def whole(folder: Path, content: Mapping[str, Any]) -> bool:
    """Whether every file of a folder, figures and pages too, is what the manifest says."""
    return not any(_differs(folder / name, digest) for name, digest in content["files"].items())


def spoiled(folder: Path) -> list[str]:
    """The data files of a folder that are not what its manifest says; the manifest, when that is damaged."""
    if not (folder / NAME).exists():
        return []
    content = _readable(folder)
    if not content:
        return [NAME]
    return [name for name, digest in _data(content).items() if _differs(folder / name, digest)]


def listed(folder: Path) -> list[str]:
    """The files of a folder that rkfbench wrote; [] where no manifest says so."""
    return list(_listed(_readable(folder)))


def digest(folder: Path) -> str:
    """A hash of the manifest of a folder, and so of all that it lists; "" where there is none."""
    path = folder / NAME
    return files.sha256(path) if path.exists() else ""


def scenario(folder: Path) -> str | None:
    """The scenario that the manifest names, also one that is damaged or of another schema; None where it has not our
    form.
    """
    if name := _readable(folder).get("scenario"):
        return str(name)
    try:
        head = _HEAD.match((folder / NAME).read_text(encoding="utf-8", errors="replace"))
    except OSError:
        return None
    return head["scenario"] if head else None


def is_sealed(folder: Path) -> bool:
    """Whether it is a results folder with a manifest that can be used."""
    return bool(_readable(folder))


def made_from(folder: Path, part: str, digest: str, *names: str) -> bool:
    """Whether the folder holds the files `names` undamaged, and their part of it was made from what has `digest`."""
    content = _readable(folder)
    if content.get("hashes", {}).get(part) != digest:
        return False
    known = content["files"]
    return all(name in known and not _differs(folder / name, known[name]) for name in names)


def machine() -> dict[str, Any]:
    """Versions, linear algebra library and hardware: what may change the last bits or the times."""
    import numpy

    blas = numpy.show_config(mode="dicts").get("Build Dependencies", {}).get("blas", {})
    return {
        "versions": {"rkfbench": _version("rkfbench"), "python": platform.python_version()}
        | {name: _version(name) for name in ("numpy", "scipy", "matplotlib")},
        "commit": _commit(),
        "blas": f"{blas.get('name', 'unknown')} {blas.get('version', '')}".strip(),
        "machine": {"system": platform.system(), "processor": platform.machine(), "cores": os.cpu_count()},
    }


def _readable(folder: Path) -> dict[str, Any]:
    """The manifest, or {} where there is none that can be used."""
    try:
        return read(folder)
    except UsageError:
        return {}


_REPAIR = "make the folder again with rkfbench run (--fresh computes everything anew)"


_HEAD = re.compile(r'\{\s*"schema": \d+,\s*"scenario": "(?P<scenario>[^"]*)"')  # how every manifest begins


def _listed(content: Mapping[str, Any]) -> dict[str, str]:
    """The hashes of the files that are ours: manifests of old list what else was there, too."""
    known = content.get("files", {})
    return {name: digest for name, digest in known.items() if name in TOP or name.split("/")[0] in FOLDERS}


def _data(content: Mapping[str, Any]) -> dict[str, str]:
    """The hashes of the files with numbers, and of the scenario."""
    return {name: digest for name, digest in _listed(content).items() if name.endswith((".csv", ".yaml"))}


def _differs(path: Path, digest: str) -> bool:
    try:
        return files.sha256(path) != digest
    except OSError:
        return True


def _own(content: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


@cache
def _commit() -> str:
    """The commit of the checkout that rkfbench runs from, with `+` when it has changes; "" when installed."""
    root = Path(__file__).parents[2]
    if not (root / ".git").exists():
        return ""
    try:
        git = ["git", "-C", str(root)]
        commit = subprocess.run([*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True).stdout.strip()
        dirty = subprocess.run([*git, "status", "--porcelain"], capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""
    return commit + ("+" if dirty.strip() else "")
