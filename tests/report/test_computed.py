"""Tables that no results enter."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from rkfbench.report import entries, latex, tables
from rkfbench.report.computed import COMPUTED, LENGTHS, SIZES, operation_counts, operation_totals
from rkfbench.report.material import Material
from rkfbench.scenario.display import Computed, Table


def test_a_scenario_may_name_every_function_and_no_other() -> None:
    assert set(get_args(Computed)) == set(COMPUTED)


@pytest.mark.parametrize("name", COMPUTED)
def test_no_cell_comes_twice_and_all_are_integers(name: str) -> None:
    cells = list(COMPUTED[name]())
    assert len({cell[:2] for cell in cells}) == len(cells)
    assert {type(count) for _, _, count in cells} == {int}


def test_the_rows_of_table_1_stand_beside_their_recount() -> None:
    cells = {(row, column): count for row, column, count in operation_counts()}
    rows = {row for row, _ in cells}
    assert len(rows) == 12 + 3
    at = "n = 4, m = 2: "
    assert [cells["(16-4) covariance P", at + each] for each in ("printed", "recounted", "difference")] == [
        288,
        304,
        -16,
    ]
    assert ("(16-2) gain L", at + "recounted") not in cells
    assert [cells[row, at + "printed"] for row in ("A: MCKF", "B: a step of FP-MCS", "D: a step of KS")] == [
        684,
        952,
        836,
    ]


def test_the_totals_stand_beside_the_sums_of_their_rows() -> None:
    cells = {(row, column): count for row, column, count in operation_totals()}
    assert len({row for row, _ in cells}) == len(SIZES) * (1 + 3 * len(LENGTHS))
    for row, column, count in operation_totals():
        if column.startswith("printed − "):
            assert count == cells[row, "printed"] - cells[row, column.removeprefix("printed − ")]
    row = "n = 4, m = 2: (30) FP-MCS, N = 100"
    assert cells[row, "sum of rows"] == 684 + 100 * 952
    assert cells[row, "with (24-1)"] == 684 + 100 * (952 + 288)
    assert cells["n = 4, m = 2: (31) KS from A without (16-3), N = 1", "printed − sum of rows"] == 18


def test_counts_are_written_with_all_their_digits_and_survive_their_csv(material: Material, tmp_path: Path) -> None:
    table = Table(id="t", computed="operation_totals")
    found = entries.of(table, material)
    (sheet,) = tables.layouts(table, found)
    assert sheet.note == "Exact counts."
    assert "| n = 6, m = 3: (30) FP-MCS, N = 1000 | 3188316 | 3224313 | −35997 |" in tables.markdown(table, [sheet])
    assert "$3188316$ & $3224313$ & $-35997$" in latex.tables(table, [sheet], "s")
    entries.write(tmp_path / "t.csv", found)
    assert entries.read(tmp_path / "t.csv") == found
