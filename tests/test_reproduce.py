"""The committed form of a results folder takes the place of the one before, and never leaves none."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

import pytest

from rkfbench import reproduce
from rkfbench.errors import UsageError
from rkfbench.scenario import load
from rkfbench.store import Results, manifest
from rkfbench.study.run import run_study


@pytest.fixture
def folder(small: Path) -> Path:
    """Results, in the current folder."""
    run_study(load(small), Path("results/small"))
    return Path("results/small")


def test_a_published_folder_is_whole_and_nothing_lies_beside_it(folder: Path) -> None:
    for _ in range(2):
        reference = reproduce.publish(folder, Path("reference/small"))
        assert Results.open(reference).summary == Results.open(folder).summary
        assert not (reference / manifest.BLOCKS).exists() and not (reference / "runs.csv").exists()
        assert [path.name for path in Path("reference").iterdir()] == ["small"]


@pytest.mark.parametrize("moment", ["copytree", "rename", "rmtree"])
@pytest.mark.parametrize("count", range(5))
def test_a_kill_at_any_moment_leaves_a_whole_reference(
    folder: Path, monkeypatch: pytest.MonkeyPatch, moment: str, count: int
) -> None:
    reference = reproduce.publish(folder, Path("reference/small"))
    (reference / "mine.txt").write_text("of the old one")
    place, name = (Path, moment) if moment == "rename" else (shutil, moment)
    real, calls = getattr(place, name), []

    def killed(*args: object, **more: object) -> object:
        calls.append(args)
        if len(calls) > count:
            raise KeyboardInterrupt
        return real(*args, **more)

    with monkeypatch.context() as patched, suppress(KeyboardInterrupt):
        patched.setattr(place, name, killed)
        reproduce.publish(folder, reference)
    there = [each for each in (reference, reference.with_name(".small.old")) if each.exists()]
    assert any(manifest.whole(each, manifest.read(each)) for each in there)
    reproduce.publish(folder, reference)
    assert [path.name for path in Path("reference").iterdir()] == ["small"]


def test_what_a_kill_has_left_aside_is_taken_back(folder: Path) -> None:
    reference = reproduce.publish(folder, Path("reference/small"))
    reference.rename(reference.with_name(".small.old"))
    with pytest.raises(UsageError, match="cannot write nowhere"):
        reproduce.publish(Path("nowhere"), reference)
    assert Results.open(reference).summary


def test_what_lies_aside_has_no_claims_to_explain(folder: Path) -> None:
    for name in ("small", ".small.old"):
        (Path("results") / name).mkdir(exist_ok=True)
        (Path("results") / name / "claims.csv").write_text("")
    assert reproduce.folders_with_claims() == [Path("results/small")]
