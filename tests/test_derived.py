"""What is made of the numbers of a folder is made again when what it depends on has changed, and only then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rkfbench import derived
from rkfbench.cli.commands import app

FOLDER = Path("results/small")
FIGURE = FOLDER / "figures" / "errors.png"


def rkfbench(*args: str | Path) -> None:
    result = CliRunner().invoke(app, [*map(str, args), "--jobs", "1"])
    assert result.exit_code == 0, result.stderr


@pytest.fixture
def run(claiming: Path) -> Path:
    """The scenario's file, run once."""
    rkfbench("run", claiming)
    return claiming


@pytest.fixture
def made(run: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The steps that later runs take."""
    steps: list[str] = []
    for step in ("write_claims", "render"):
        original = getattr(derived, step)

        def wrapped(*args: Any, step: str = step, original: Any = original) -> Any:
            steps.append(step)
            return original(*args)

        monkeypatch.setattr(derived, step, wrapped)
    return steps


def test_nothing_is_made_again_when_nothing_has_changed(run: Path, made: list[str]) -> None:
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in FOLDER.rglob("*") if path.is_file()}
    rkfbench("run", run)
    assert made == []
    after = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in FOLDER.rglob("*") if path.is_file()}
    assert after == before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("{id: errors, kind: curve", "{id: errors, title: Other words, kind: curve"),
        ("says: outliers make", "says: gross outliers make"),
    ],
    ids=["figure", "claim"],
)
def test_a_change_of_what_is_shown_or_claimed_is_seen(run: Path, made: list[str], old: str, new: str) -> None:
    blocks = {path: path.stat().st_mtime_ns for path in (FOLDER / "blocks").iterdir()}
    run.write_text(run.read_text().replace(old, new))
    rkfbench("run", run)
    assert made == ["write_claims", "render"]
    assert {path: path.stat().st_mtime_ns for path in (FOLDER / "blocks").iterdir()} == blocks


@pytest.mark.parametrize("damage", [lambda: FIGURE.write_bytes(b"damaged"), lambda: FIGURE.unlink()])
def test_what_is_damaged_or_missing_is_made_again_to_the_same_bytes(run: Path, made: list[str], damage: Any) -> None:
    before = FIGURE.read_bytes()
    damage()
    rkfbench("run", run)
    assert made == ["write_claims", "render"]
    assert FIGURE.read_bytes() == before


def test_a_change_of_the_sources_is_seen(run: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(derived, "_sources", lambda: "other")
    rkfbench("run", run)
    assert made == ["write_claims", "render"]


def test_what_was_not_finished_is_begun_anew(run: Path, made: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    FIGURE.write_bytes(b"damaged")

    def fails(*args: Any) -> None:
        raise OSError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(derived, "render", fails)
        assert CliRunner().invoke(app, ["run", str(run), "--jobs", "1"]).exit_code == 1
    made.clear()
    rkfbench("run", run)
    assert made == ["write_claims", "render"]
    assert FIGURE.read_bytes() != b"damaged"


def test_report_draws_always(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    time = FIGURE.stat().st_mtime_ns
    assert CliRunner().invoke(app, ["report", str(FOLDER)]).exit_code == 0
    assert FIGURE.stat().st_mtime_ns > time


def test_the_report_of_a_reproduction_is_written_again_when_it_or_a_folder_has_changed(
    claiming: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rkfbench.scenario.files.FOLDER", claiming.parent)
    page = Path("results/report.html")
    rkfbench("reproduce")
    text, time = page.read_text(), page.stat().st_mtime_ns
    rkfbench("reproduce")
    assert page.stat().st_mtime_ns == time
    page.write_text(text.replace("</title>", " edited</title>"))
    rkfbench("reproduce")
    assert page.read_text() == text
    FIGURE.unlink()
    Path("results/report.md").unlink()
    rkfbench("reproduce")
    assert page.read_text() == text
    assert Path("results/report.md").exists()
