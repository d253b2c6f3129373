"""What is made of the numbers of a results folder: claims, tables and figures, made again only when something changed.

They are a function of the folder's other files, of the paper's file, of what its scenarios offer to claims, of the
sources of rkfbench and of Matplotlib. The manifest holds a digest of these, written when all is made; a file that is
missing or damaged is noticed by its own hash.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rkfbench.judge import dockets, write_claims
from rkfbench.pool import Pool
from rkfbench.report.render import render
from rkfbench.scenario import Scenario
from rkfbench.scenario.files import find, papers
from rkfbench.store import files, manifest
from rkfbench.study import plan
from rkfbench.study.run import DERIVED

HASH = "derived"


def update(scenario: Scenario, folder: Path, pool: Pool, *, fresh: bool = False) -> None:
    """Judge the claims of a folder and write its tables and figures, unless they are there as they would be made."""
    content = manifest.read(folder)
    made_from = _digest(scenario, content)
    if not fresh and content["hashes"].get(HASH) == _made(made_from, content) and manifest.whole(folder, content):
        return
    manifest.seal(folder, hashes={HASH: ""})  # whatever ends this early, the next call begins anew
    write_claims(scenario, folder)
    render(folder, pool)
    manifest.seal(folder, hashes={HASH: _made(made_from, manifest.read(folder))})


def _made(made_from: str, content: Mapping[str, Any]) -> str:
    """A digest of what the derived files were made from and of their names: one that was taken away is missed."""
    return plan.digest([made_from, sorted(name for name in content["files"] if name.split("/")[0] in DERIVED)])


def of_report(folders: Sequence[Path]) -> str:
    """A digest of all that the report of some results folders depends on."""
    return plan.digest([_sources(), [[str(folder), files.sha256(folder / manifest.NAME)] for folder in folders]])


def _digest(scenario: Scenario, content: Mapping[str, Any]) -> str:
    """A hash of all that the derived files of a folder depend on."""
    numbers = {name: digest for name, digest in content["files"].items() if name.split("/")[0] not in DERIVED}
    paper = files.sha256(find(scenario.paper, papers(), "paper file")) if scenario.paper else ""
    outlines = [{name: asdict(each) for name, each in docket.outlines.items()} for docket in dockets(scenario)]
    tuning = content["hashes"].get(manifest.TUNING, "")
    return plan.digest([numbers, tuning, paper, outlines, _sources(), version("matplotlib")])


@cache
def _sources() -> str:
    """A hash of all sources of rkfbench, its templates included."""
    root = Path(__file__).parent
    return plan.hash_files(root, sorted(path for path in root.rglob("*") if path.suffix in (".py", ".j2", ".css")))
