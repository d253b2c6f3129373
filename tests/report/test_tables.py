from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rkfbench.report import entries, tables
from rkfbench.report.material import Material
from rkfbench.report.words import Words
from rkfbench.scenario.display import Table
from rkfbench.scenario.paper_schema import PrintedLine, PrintedRow
from rkfbench.store import Results
from tests.report import fakes


def sheet(table: Table, material: Material, reading: str = "literal", decimals: int | None = None) -> tables.Sheet:
    sheets = tables.layouts(table, entries.of(table, material), decimals)
    return next(each for each in sheets if each.reading == reading)


def test_a_printed_table_gives_rows_columns_and_headings(material: Material) -> None:
    found = sheet(Table(id="t", paper="table-1"), material, decimals=2)
    assert found.headings == ("KF", "HKF", "ALADKF")
    assert [line.heading for line in found.lines] == ["case 1", "case 2", "case 3", "case 4"]
    assert found.lines[0].printed == ("4.10", "1.50", "")
    cell = found.lines[1].cells[0]
    assert cell is not None
    assert cell.value == material.summary["literal", "rate=0.2", "kf", "err_norm"]["mean"]


def spread_table(material: Material) -> Material:
    """Mean and sd of one filter in one case, printed from 20 runs."""
    columns = [PrintedLine(label="mean", filter="kf"), PrintedLine(label="sd", filter="kf", statistic="sd")]
    rows = [PrintedRow(label="x", case="rate=0.2", values=[4.0, 0.5])]
    return fakes.material(material.results, fakes.printed_table(columns=columns, rows=rows, runs=20))


def test_under_a_printed_number_stand_ratio_z_and_the_range_over_batches_of_the_papers_runs(material: Material) -> None:
    key = "literal", "rate=0.2", "kf", "err_norm"
    x = material.results.values(*key)
    mean, sd = entries.of(Table(id="t", paper="table-1"), spread_table(material))[:2]
    assert mean.ratio == pytest.approx(x.mean() / 4)
    assert mean.z == pytest.approx((x.mean() - 4) / np.sqrt(x.var(ddof=1) / 60 + 0.5**2 / 20))  # the printed sd
    assert sd.se is not None
    of_the_paper = 0.5 * sd.se / x.std(ddof=1) * np.sqrt(60 / 20)
    assert sd.z == pytest.approx((x.std(ddof=1) - 0.5) / np.hypot(sd.se, of_the_paper))
    for entry, statistic in ((mean, np.mean(x.reshape(3, 20), 1)), (sd, np.std(x.reshape(3, 20), 1, ddof=1))):
        assert (entry.batches, entry.batch_runs) == (3, 20)
        assert (entry.batch_low, entry.batch_high) == pytest.approx((statistic.min(), statistic.max()))
    lines = tables.markdown(
        Table(id="t", paper="table-1"), [sheet(Table(id="t", paper="table-1"), spread_table(material))]
    )
    assert [line.split("|")[1].strip() for line in lines.splitlines()[4:8]] == [
        "x",
        "*paper*",
        "*ours/paper; z*",
        "*range of 3 × 20 runs*",
    ]


def test_what_is_the_same_in_every_run_has_no_z(results: Results) -> None:
    own = spread_table(fakes.material(results))
    row = own.summary["literal", "rate=0.2", "kf", "err_norm"]
    own.summary["literal", "rate=0.2", "kf", "err_norm"] = {**row, "se": 1e-15 * row["mean"]}
    mean = entries.of(Table(id="t", paper="table-1"), own)[0]
    assert mean.z is None
    assert mean.ratio is not None


def test_fewer_than_two_batches_have_no_range_and_times_no_z(material: Material) -> None:
    (mean, *_) = entries.of(Table(id="t", paper="table-1"), material)
    assert mean.ratio is not None
    assert mean.batches is None
    timed = fakes.printed_table(
        columns=[PrintedLine(label="KF", filter="kf", metric="time_ms")],
        rows=[PrintedRow(label="x", case="rate=0.05", values=[14.0])],
    )
    (time,) = entries.of(Table(id="t", paper="table-1"), fakes.material(material.results, timed))
    assert (time.ratio, time.z) == (None, None)


def test_printed_numbers_without_ours_are_shown_all_the_same(material: Material) -> None:
    printed = fakes.printed_table(
        columns=[PrintedLine(label="PF", filter="pf")], rows=[PrintedRow(label="x", case="R9", values=[3.0])]
    )
    table = Table(id="t", paper="table-1")
    text = tables.markdown(table, [sheet(table, fakes.material(material.results, printed))])
    assert text.splitlines()[4:6] == ["| x | – |", "| *paper* | *3* |"]


def test_rows_and_columns_may_be_any_of_case_filter_and_metric(material: Material) -> None:
    table = Table(id="t", metric=["err_norm", "cond_S"], rows="filter", columns="metric", cases=["rate=0.4"])
    found = sheet(table, material)
    assert found.headings == ("error norm", "cond(S)")
    assert [line.heading for line in found.lines] == ["clairvoyant KF", "KF", "HKF", "ALADKF"]


def test_own_metrics_that_would_be_called_alike_keep_their_files() -> None:
    own = ["a.py:worst[px]", "b.py:worst[px]", "b.py:best", "rmse"]
    assert list(entries.metric_names(own, Words()).values()) == ["a.py:worst[px]", "b.py:worst[px]", "best", "RMSE"]
    named = Words({"score": "RMSE"})
    assert list(entries.metric_names(["score", "rmse"], named).values()) == ["RMSE", "RMSE"]  # as the scenario says


def test_results_beside_the_readings_of_the_scenario_are_shown_where_they_are_asked_for(material: Material) -> None:
    switched = Material(material.results, readings=("literal",))  # so that `root` is like a switch

    def readings(**asked: list[str]) -> list[str]:
        table = Table(id="t", metric="err_norm", **asked)
        return [each.reading for each in tables.layouts(table, entries.of(table, switched))]

    assert readings() == ["literal"]
    assert readings(readings=["literal", "root"]) == ["literal", "root"]
    assert switched.own_readings == ["literal"]


def test_what_has_several_values_and_no_place_becomes_rows(material: Material) -> None:
    table = Table(id="t", metric=["err_norm", "cond_S"], statistic=["mean", "sd"], cases=["rate=0.4"])
    headings = [line.heading for line in sheet(table, material).lines]
    expected = [f"{metric}, {what}" for metric in ("error norm", "cond(S)") for what in ("mean", "sd")]
    assert headings == [f"rate = 0.4, {each}" for each in expected]


def test_where_runs_were_lost_the_median_and_the_counts_stand_beside(material: Material) -> None:
    table = Table(id="t", metric="err_norm", filters=["kf", "hkf"], cases=["rate=0.4"])
    found = sheet(table, material)
    kf, hkf = found.lines[0].cells
    assert kf is not None
    assert hkf is not None
    assert kf.note.startswith("median ")
    assert hkf.note == ""
    assert f"KF: {kf.lost} lost" in found.note


def test_a_filter_of_which_every_run_failed_has_no_mean_and_an_infinite_median(tmp_path: Path) -> None:
    dead = fakes.material(fakes.write_results(tmp_path, dead="hkf"))
    table = Table(id="t", metric="err_norm", filters=["hkf"], cases=["rate=0.4"])
    text = tables.markdown(table, [sheet(table, dead)])
    assert "| rate = 0.4 | – (median ∞) |" in text
    assert f"Runs failed (left out of means) or lost. HKF: {fakes.RUNS} failed" in text
    medians = table.model_copy(update={"statistic": "median"})
    assert "Runs failed (infinite in medians) or lost." in tables.markdown(medians, [sheet(medians, dead)])


def test_times_say_repeats_and_stand_under_one_reading(material: Material) -> None:
    table = Table(id="t", metric="time_ms", unit="ms", filters=["kf", "hkf"])
    sheets = tables.layouts(table, entries.of(table, material))
    assert [each.reading for each in sheets] == ["literal"]
    assert "over 3 repeats" in sheets[0].note


def test_runs_and_repeats_are_counted_apart_and_a_largest_value_has_no_error(material: Material) -> None:
    both = Table(id="t", metric=["err_norm", "time_ms"], rows="filter", columns="metric", cases=["rate=0.05"])
    assert "Mean over 60 runs and 3 repeats of a time ± one standard error." in sheet(both, material).note
    largest = Table(id="t", metric="err_norm", statistic=["median", "max"], cases=["rate=0.05"])
    assert "over 60 runs ± one standard error (of a max: none)" in sheet(largest, material).note


def test_markdown_escapes_bars(material: Material) -> None:
    printed = fakes.printed_table(
        columns=[PrintedLine(label="|x|", filter="kf")], rows=[PrintedRow(label="a", case="rate=0.2", values=[1.0])]
    )
    table = Table(id="t", paper="table-1")
    assert r"|  | \|x\| |" in tables.markdown(table, [sheet(table, fakes.material(material.results, printed))])


def test_what_has_no_title_is_called_by_its_id_in_words(material: Material) -> None:
    table = Table(id="lost_runs", metric="err_norm")
    assert tables.markdown(table, [sheet(table, material)]).startswith("# Lost runs\n")


def test_entries_survive_their_csv(material: Material, tmp_path: Path) -> None:
    found = entries.of(Table(id="t", paper="table-1"), material)
    entries.write(tmp_path / "t.csv", found)
    assert entries.read(tmp_path / "t.csv") == found
