"""Tables whose metric is arithmetic with the statistics of metrics, such as a ratio of means."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rkfbench.claims.estimand import Estimand, Point
from rkfbench.claims.expression import parse
from rkfbench.claims.measure import observe
from rkfbench.report import entries
from rkfbench.report.material import Material, is_timing
from rkfbench.report.words import Words
from rkfbench.scenario.display import Table
from rkfbench.scenario.paper_schema import PrintedLine, PrintedRow
from tests.report import fakes

RATIO = "100 * (cond_S - err_norm) / cond_S"
KEY = ("literal", "rate=0.4", "kf", RATIO)


def test_a_ratio_of_means_has_the_error_of_the_jackknife_over_paired_runs(material: Material) -> None:
    errors, conditions = (material.results.values(*KEY[:3], name) for name in ("err_norm", "cond_S"))
    total = 100 * (1 - errors.sum() / conditions.sum())
    without = 100 * (1 - (errors.sum() - errors) / (conditions.sum() - conditions))
    n = errors.size
    expected = total, np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())
    assert material.estimate(KEY, "mean") == pytest.approx(expected)


def test_arithmetic_over_times_alone_is_a_time() -> None:
    assert [name for name in ("time_ms", "2 * time_ms", "time_ms / rmse", "timeline") if is_timing(name)] == [
        "time_ms",
        "2 * time_ms",
    ]


@pytest.mark.parametrize("statistic", ["mean", "median", "sd"])
def test_a_table_says_what_a_claim_says(material: Material, statistic: str) -> None:
    point = Point(parse(RATIO), parse("kf"), parse("rate=0.4"))
    measured = observe(Estimand("value", (point,), statistic), material.results, "literal").measured
    assert material.estimate(KEY, statistic) == pytest.approx((measured.estimate, measured.se))


def test_failed_runs_are_left_out_together(tmp_path: Path) -> None:
    results = fakes.write_results(tmp_path)
    table = results._per_run["literal", "rate=0.4", "kf"]
    table["err_norm"] = np.where(np.arange(fakes.RUNS) < 5, np.nan, table["err_norm"])
    table["failed"] = np.where(np.arange(fakes.RUNS) == 9, 1.0, 0.0)
    used = np.array([i >= 5 and i != 9 for i in range(fakes.RUNS)])
    expected = 100 * (1 - table["err_norm"][used].sum() / table["cond_S"][used].sum())
    assert fakes.material(results).estimate(KEY, "mean")[0] == pytest.approx(expected)


def test_without_numbers_per_run_the_means_give_it_without_an_error(tmp_path: Path) -> None:
    without = fakes.material(fakes.write_results(tmp_path, with_runs=False))
    means = {name: without.summary[*KEY[:3], name]["mean"] for name in ("err_norm", "cond_S")}
    expected = 100 * (means["cond_S"] - means["err_norm"]) / means["cond_S"]
    assert without.estimate(KEY, "mean") == (pytest.approx(expected), None)
    assert entries.needs_runs(Table(id="t", metric=[RATIO]))
    assert not entries.needs_runs(Table(id="t", metric=["err_norm"]))


def test_counts_and_medians_stand_beside_and_unknown_parts_leave_the_cell_out(material: Material) -> None:
    table = Table(id="t", metric=[RATIO, "err_norm - mse"], filters=["kf"], cases=["rate=0.4"], readings=["literal"])
    (entry,) = entries.of(table, material)
    rows = {name: material.summary[*KEY[:3], name] for name in ("err_norm", "cond_S")}
    medians = {name: row["median"] for name, row in rows.items()}
    assert entry.median == pytest.approx(100 * (medians["cond_S"] - medians["err_norm"]) / medians["cond_S"])
    assert (entry.runs, entry.failed, entry.lost) == tuple(rows["cond_S"][each] for each in ("runs", "failed", "lost"))


def test_one_printed_number_may_be_read_in_several_ways(material: Material) -> None:
    columns = [PrintedLine(label=each, metric=each) for each in ("err_norm", RATIO)]
    rows = [PrintedRow(label="KF", filter="kf", case="rate=0.4", values=[3.0])]
    printed = fakes.printed_table(columns=columns, rows=rows, runs=20, once=True)
    plain, ratio = entries.of(
        Table(id="t", paper="table-1", readings=["literal"]), fakes.material(material.results, printed)
    )
    assert (plain.printed, ratio.printed) == (3.0, 3.0)
    value, se = material.estimate(KEY, "mean")
    assert se is not None
    assert ratio.z == pytest.approx((value - 3) / (se * np.sqrt(1 + 60 / 20)))
    errors, conditions = (material.results.values(*KEY[:3], name).reshape(3, 20) for name in ("err_norm", "cond_S"))
    batches = 100 * (1 - errors.mean(1) / conditions.mean(1))
    assert (ratio.batch_low, ratio.batch_high) == pytest.approx((batches.min(), batches.max()))


def test_a_row_that_is_read_in_several_ways_has_one_number() -> None:
    with pytest.raises(ValueError, match="has 3 values for all columns"):
        fakes.printed_table(once=True)


def test_the_share_of_lost_runs_may_take_part(material: Material) -> None:
    lost = material.results.lost(*KEY[:3]).mean()
    assert material.estimate((*KEY[:3], "100 * lost"), "mean")[0] == pytest.approx(100 * lost)


def test_arithmetic_is_called_by_the_names_of_its_metrics_or_its_own() -> None:
    assert Words().metric("100 * (mse@j+0 - mse@j) / mse@j+0") == "100 * (MSE at lag 0 - MSE) / MSE at lag 0"
    assert Words({"a - b": "difference"}).metric("a - b") == "difference"
