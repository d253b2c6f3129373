from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rkfbench.errors import UsageError
from rkfbench.pool import Pool
from rkfbench.report.render import Outcome, render
from rkfbench.store import Results, files, manifest
from tests.report import fakes

FIGURES = ("fig1.literal", "fig1.root", "fig2.literal", "fig3.literal")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Path]]:
    """A rendered folder, and what `render` says that it wrote."""
    folder = fakes.write_results(tmp_path_factory.mktemp("rendered")).folder
    return folder, render(folder)


def made(folder: Path) -> dict[str, bytes]:
    places = (folder / "tables", folder / "figures")
    return {path.name: path.read_bytes() for place in places for path in sorted(place.iterdir())}


def test_every_figure_and_table_is_written_and_the_folder_is_sealed(rendered: tuple[Path, list[Path]]) -> None:
    folder, written = rendered
    expected = [f"{figure}.{kind}" for figure in FIGURES for kind in ("png", "pdf", "csv")]
    expected += [f"{table}.{kind}" for table in ("table1", "table2") for kind in ("csv", "md", "tex")]
    assert sorted(path.name for path in written) == sorted(expected)
    assert "figures/fig1.root.png" in Results.open(folder).manifest["files"]


def test_any_number_of_processes_draws_the_same_bytes(
    rendered: tuple[Path, list[Path]], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rkfbench.pool.START_UP", 0)
    with Pool(2) as pool:
        assert [path.name for path in render(folder, pool)] == [path.name for path in rendered[1]]
    assert made(folder) == made(rendered[0])


def test_a_folder_without_the_numbers_of_single_runs_renders_to_the_same_bytes(
    rendered: tuple[Path, list[Path]], tmp_path: Path
) -> None:
    folder = shutil.copytree(rendered[0], tmp_path / "published")
    (folder / "runs.csv").unlink()
    manifest.seal(folder)
    render(folder)
    assert made(folder) == made(rendered[0])


def test_a_figure_without_numbers_is_left_out(tmp_path: Path) -> None:
    fakes.write_results(tmp_path, with_runs=False)
    assert "fig2.literal" not in [picture.stem for picture in Outcome.open(tmp_path).pictures()]


def test_the_data_behind_a_forest_are_the_numbers_of_the_ledger(rendered: tuple[Path, list[Path]]) -> None:
    rows = files.read_records(rendered[0] / "figures" / "fig3.literal.csv")
    assert [(row["claim"], row["cells"], row["verdict"]) for row in rows] == [
        ("mine-1", 2, "reproduced"),
        ("mine-2", 1, "not reproduced"),
    ]
    assert rows[0]["estimand"] == "kf - hkf in err_norm at rate=0.05"


def test_an_edited_number_is_refused(folder: Path) -> None:
    path = folder / "summary.csv"
    path.write_text(path.read_text().replace("literal", "1iteral", 1))
    with pytest.raises(UsageError, match=r"summary\.csv"):
        render(folder)
