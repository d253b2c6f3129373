"""Exact checks of a study: run once for a state of the code, kept in checks.csv."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from rkfbench.claims.checks import checks_of
from rkfbench.store import files, manifest
from rkfbench.study import plan

NAME = "checks.csv"
COLUMNS = ("id", "deviation", "tolerance", "note")


def update(paper: str, ids: Collection[str], folder: Path, *, fresh: bool = False) -> None:
    """Run the checks `ids` of a paper, unless the folder has what the same code gave."""
    if not ids:
        return
    made_from = plan.digest([plan.code_hash(), _code_of_checks(), sorted(ids)])
    if manifest.made_from(folder, "checks", made_from, NAME) and not fresh:
        return
    outcomes = [(id, check()) for id, check in checks_of(paper).items() if id in ids]
    files.write_csv(
        folder / NAME,
        COLUMNS,
        [[id, float(each.deviation), float(each.tolerance), each.note] for id, each in outcomes],
    )
    manifest.seal(folder, NAME, hashes={"checks": made_from})


def _code_of_checks() -> str:
    root = Path(__file__).parents[1]
    return plan.hash_files(root, sorted((root / "claims/checks").glob("*.py")))
