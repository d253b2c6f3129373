from __future__ import annotations

from pathlib import Path

import pytest

from rkfbench.errors import UsageError
from rkfbench.report.render import Outcome, render
from rkfbench.store import Results, files
from tests.report import fakes

FIGURES = ["fig1.literal", "fig1.root", "fig2.literal", "fig3.literal", "fig3.root", "fig4.literal", "fig4.root"]


def made(folder: Path) -> dict[str, bytes]:
    places = (folder / "tables", folder / "figures")
    return {path.name: path.read_bytes() for place in places for path in sorted(place.iterdir())}


def test_every_figure_and_table_is_written_and_the_folder_is_sealed(folder: Path) -> None:
    written = render(folder)
    assert sorted(path.name for path in written) == sorted(
        [f"{figure}.{kind}" for figure in FIGURES for kind in ("png", "pdf", "csv")]
        + [f"{table}.{kind}" for table in ("table1", "table2") for kind in ("csv", "md", "tex")]
    )
    assert "figures/fig1.root.png" in Results.open(folder).manifest["files"]


def test_rendering_again_gives_the_same_bytes(folder: Path) -> None:
    render(folder)
    first = made(folder)
    render(folder)
    assert made(folder) == first


def test_without_the_numbers_of_single_runs_everything_renders_from_what_is_kept(folder: Path) -> None:
    render(folder)
    before = made(folder)
    (folder / "runs.csv").unlink()
    fakes.manifest.seal(folder)
    render(folder)
    assert made(folder) == before


def test_a_figure_without_numbers_is_left_out(tmp_path: Path) -> None:
    fakes.write_results(tmp_path, with_runs=False)
    assert "fig2.literal" not in [picture.stem for picture in Outcome.open(tmp_path).pictures()]


def test_the_data_behind_a_forest_are_the_numbers_of_the_ledger(folder: Path) -> None:
    render(folder)
    rows = files.read_records(folder / "figures" / "fig4.literal.csv")
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
