from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from rkfbench.report import points as of
from rkfbench.report.material import Material
from rkfbench.report.points import Point
from rkfbench.scenario.display import Figure
from rkfbench.store import Results
from tests.report import fakes


def points(material: Material, reading: str = "literal", **figure: Any) -> list[Point]:
    return of.points(TypeAdapter(Figure).validate_python({"id": "f", **figure}), material, reading)


def test_a_sweep_has_one_point_a_value_and_filter_with_an_interval_of_two_standard_errors(material: Material) -> None:
    found = points(material, kind="sweep", over="rate", metric="cond_S", filters=["kf", "hkf"])
    row = material.summary["literal", "rate=0.2", "kf", "cond_S"]
    second = found[1]
    assert [point.x for point in found] == [*fakes.RATES, *fakes.RATES]
    assert (second.y, second.low, second.high) == (
        row["mean"],
        row["mean"] - 2 * row["se"],
        row["mean"] + 2 * row["se"],
    )
    assert second.case == ""


def test_a_sweep_over_a_parameter_joins_the_variants_and_lays_the_others_level(material: Material) -> None:
    found = points(material, kind="sweep", over="hkf.threshold", metric="err_norm", cases=["rate=0.4"])
    assert sorted(point.x for point in found if point.role == "ours") == [0.5, 1.345, 3.0]
    assert {point.filter for point in found if point.role == "ours"} == {"hkf"}
    assert {point.filter for point in found if point.role == "level"} == {"clairvoyant_kf", "kf", "aladkf"}


def test_curves_leave_extras_out_unless_they_are_named(material: Material) -> None:
    default = points(material, kind="curve", metric="err_norm@k", cases=["rate=0.4"])
    named = points(material, kind="curve", metric="err_norm@k", cases=["rate=0.4"], filters=["hkf[threshold=3]"])
    assert {point.filter for point in default} == set(fakes.LEVEL) - fakes.EXTRAS
    assert [point.x for point in named] == list(range(1, fakes.STEPS + 1))


def test_a_prior_goes_with_each_curve_and_has_no_step(material: Material) -> None:
    asked = {"kind": "curve", "metric": ["err_norm@k", "rmse@k"], "cases": ["rate=0.4"], "filters": ["kf", "hkf"]}
    found = points(material, before=["err_norm", "cond_S"], **asked)
    priors = [point for point in found if point.role == "before"]
    assert [(each.filter, each.metric, each.x) for each in priors] == [
        ("kf", "err_norm@k", None),
        ("kf", "rmse@k", None),
        ("hkf", "err_norm@k", None),
        ("hkf", "rmse@k", None),
    ]
    row = material.summary["literal", "rate=0.4", "hkf", "cond_S"]
    assert (priors[3].y, priors[3].low) == (row["mean"], row["mean"] - 2 * row["se"])
    assert [point for point in found if point.role != "before"] == points(material, **asked)


def test_runs_are_the_first_ones(material: Material) -> None:
    found = points(material, kind="runs", metric="err_norm", cases=["rate=0.05"], filters=["kf"], first=7)
    assert [point.x for point in found] == [1, 2, 3, 4, 5, 6, 7]
    assert found[0].y == material.results.values("literal", "rate=0.05", "kf", "err_norm")[0]


def test_bars_stand_beside_the_printed_numbers(material: Material) -> None:
    found = points(material, kind="bars", metric="err_norm", filters=["kf", "aladkf"], paper="table-1")
    printed = [point for point in found if point.role == "paper"]
    assert [(point.filter, point.y) for point in printed] == [("kf", 4.1)] * 4


def test_the_error_of_a_median_comes_from_the_runs(material: Material) -> None:
    key = ("literal", "rate=0.2", "kf", "err_norm")
    middle, error = material.estimate(key, "median")
    assert middle == pytest.approx(material.summary[key]["median"])
    assert error is not None
    assert 0.5 < error / material.summary[key]["se"] < 2.5


def test_a_median_has_an_interval_between_two_runs_however_skewed(results: Results, monkeypatch: Any) -> None:
    values = np.concatenate([np.linspace(1, 2, 31), np.geomspace(1e3, 1e9, 29)])  # half of the runs got lost
    monkeypatch.setattr(results, "values", lambda *key: values)
    (point,) = points(fakes.material(results), kind="sweep", over="rate", metric="err_norm", statistic="median",
                      filters=["kf"], cases=["rate=0.2"])  # fmt: skip
    ordered = np.sort(values)
    assert (point.low, point.high) == (ordered[21], ordered[38])  # P(X < 22) = 0.014 for 60 runs
    assert point.y == pytest.approx(np.median(values))


def test_the_share_of_lost_runs_is_a_metric(material: Material) -> None:
    lost = int(material.results.lost("literal", "rate=0.4", "kf").sum())
    (point,) = points(material, kind="bars", metric="lost", cases=["rate=0.4"], filters=["kf"])
    share = lost / fakes.RUNS
    assert point.y == share
    assert point.high == pytest.approx(share + 2 * math.sqrt(share * (1 - share) / fakes.RUNS), rel=0.1)


def test_no_lost_run_says_how_rare_they_are_and_not_that_there_are_none(material: Material) -> None:
    (point,) = points(material, kind="bars", metric="lost", cases=["rate=0.05"], filters=["hkf"])
    value, se = material.estimate(("literal", "rate=0.05", "hkf", "lost"), "mean")
    assert (point.y, point.low, value) == (0.0, 0.0, 0.0)
    assert se == pytest.approx(1 / fakes.RUNS, rel=0.1)
    assert point.high == 2 * se


def test_times_are_means_over_the_repeats(material: Material) -> None:
    (point,) = points(material, kind="bars", metric="time_ms", filters=["kf"])
    assert (point.y, point.runs) == (15.0, 3)


def test_points_survive_their_csv(material: Material, tmp_path: Path) -> None:
    found = points(material, kind="sweep", over="rate", metric="cond_S")
    found.append(Point("ours", "literal", "", "kf", "cond_S", "text", math.inf))
    of.write_points(tmp_path / "points.csv", found)
    assert of.read_points(tmp_path / "points.csv") == found


def test_a_sweep_over_a_parameter_leaves_out_variants_with_a_label_of_their_own(material: Material) -> None:
    found = material.parameter_values("hkf", "threshold")
    assert list(found) == ["hkf[threshold=0.5]", "hkf", "hkf[threshold=3]"]
    other = fakes.material(material.results)
    other.filters["hkf-guarded"] = {**other.filters["hkf"], "label": "hkf-guarded"}
    other.names["hkf-guarded"] = "hkf"
    assert other.parameter_values("hkf", "threshold") == found
    assert list(other.parameter_values("hkf-guarded", "threshold")) == []
