from __future__ import annotations

import math
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from rkfbench.report import figures, style
from rkfbench.report.captions import averaged, caption
from rkfbench.report.material import Material
from rkfbench.report.points import Lines, Point, points
from rkfbench.report.words import Words
from rkfbench.scenario.display import Figure
from tests.report import fakes

KINDS: dict[str, dict[str, Any]] = {
    "curve": {"kind": "curve", "metric": "err_norm@k", "cases": ["rate=0.05", "rate=0.4"]},
    "curve beside another": {"kind": "curve", "metric": "err_norm@k", "beside": "rmse@k", "cases": ["rate=0.4"]},
    "curve after a prior": {"kind": "curve", "metric": "err_norm@k", "before": "err_norm", "cases": ["rate=0.4"]},
    "panels": {"kind": "panels", "metric": "err_norm@k", "band": "rmse@k", "share": "row", "cases": ["rate=0.4"]},
    "sweep": {"kind": "sweep", "over": "rate", "metric": "cond_S", "whiskers": "sd"},
    "sweep of a parameter": {"kind": "sweep", "over": "hkf.threshold", "metric": ["err_norm", "cond_S"]},
    "runs": {"kind": "runs", "metric": "err_norm", "cases": ["rate=0.4"]},
    "bars": {"kind": "bars", "metric": "err_norm", "paper": "table-1"},
    "bars on a logarithmic axis": {"kind": "bars", "metric": "err_norm", "y": {"log": True}},
}


def declared(**keys: Any) -> Lines:
    return TypeAdapter(Figure).validate_python({"id": "f", **keys})  # type: ignore[no-any-return]


def drawn(figure: Lines, found: list[Point], text: str = "") -> Any:
    looks = style.looks([*fakes.LEVEL, "other"])
    with style.styled():
        sheet = figures.draw(figure, found, looks, text)
        style.png(sheet, dpi=40)  # an error of drawing shows only now
    return sheet


@pytest.mark.parametrize("keys", KINDS.values(), ids=KINDS.keys())
def test_every_kind_can_be_drawn(keys: dict[str, Any], material: Material) -> None:
    figure = declared(**keys)
    sheet = drawn(figure, points(figure, material, "literal"))
    assert any(ax.lines or ax.patches or ax.collections for ax in sheet.axes)


@pytest.mark.parametrize("keys", KINDS.values(), ids=KINDS.keys())
def test_no_value_stops_a_figure(keys: dict[str, Any], material: Material) -> None:
    figure = declared(**keys)
    found = points(figure, material, "literal")
    values = cycle([1.0, math.nan, math.inf, -math.inf, 0.0, 1e300, -1e300, 1e-300])
    mixed = [point._replace(y=y, low=y, high=y) for point, y in zip(found, values, strict=False)]
    drawn(figure, mixed)
    drawn(figure, [point._replace(y=math.nan, low=None, high=None) for point in found])


def test_priors_stand_side_by_side_at_the_left_of_the_first_step(material: Material) -> None:
    figure = declared(**KINDS["curve after a prior"])
    found = points(figure, material, "literal")
    (ax,) = drawn(figure, found).axes
    places = sorted({x for line in ax.lines for x in line.get_xdata() if x < 1})
    assert len(places) == len({point.filter for point in found})
    assert -0.2 * fakes.STEPS < places[0] < places[-1] < 1
    assert min(ax.get_xticks()) >= 1
    assert "marks at the left: error norm" in caption(figure, found)


def test_a_filter_of_which_every_run_failed_leaves_a_gap(tmp_path: Path) -> None:
    dead = fakes.material(fakes.write_results(tmp_path, dead="hkf"))
    figure = declared(kind="curve", metric="err_norm@k", cases=["rate=0.4"], filters=["kf", "hkf"])
    (ax,) = drawn(figure, points(figure, dead, "literal")).axes
    assert sorted(bool(np.isfinite(line.get_ydata()).any()) for line in ax.lines) == [False, True]


def test_equal_data_gives_equal_bytes(material: Material) -> None:
    figure = declared(kind="curve", metric="err_norm@k", cases=["rate=0.4"])
    found = points(figure, material, "literal")
    looks = style.looks(list(fakes.LEVEL))
    with style.styled():
        first, second = (figures.draw(figure, found, looks, "A caption.") for _ in range(2))
        assert style.png(first) == style.png(second)
        assert style.pdf(first) == style.pdf(second)
        assert b"Software" not in style.png(first)
        assert b"CreationDate" not in style.pdf(first)


def test_a_matrix_of_panels_names_columns_above_and_rows_at_the_left(material: Material) -> None:
    figure = declared(kind="panels", metric="err_norm@k", filters=["kf", "hkf"])
    axes = drawn(figure, points(figure, material, "literal")).axes
    assert [ax.get_title(loc="left") for ax in axes] == ["KF", "HKF"] + [""] * 6
    assert axes[2].get_ylabel() == "rate = 0.2\nerror norm"


def test_one_long_line_of_panels_is_wrapped(material: Material) -> None:
    figure = declared(kind="curve", metric="err_norm@k")
    grid = figures.layout(figure, points(figure, material, "literal"))
    assert grid.shape == (2, 2)


@pytest.mark.parametrize(("low", "scale"), [(0.5, "linear"), (1e-4, "log")])
def test_values_over_more_than_three_decades_get_a_logarithmic_axis(low: float, scale: str) -> None:
    figure = declared(kind="sweep", over="rate", metric="rmse")
    found = [Point("ours", "", "", "kf", "rmse", x, y) for x, y in ((1, low), (2, 1.0))]
    assert drawn(figure, found).axes[0].get_yscale() == scale


def test_the_legend_shows_what_stands_for_a_bar_on_a_logarithmic_axis(material: Material) -> None:
    figure = declared(**KINDS["bars on a logarithmic axis"])
    sheet = drawn(figure, points(figure, material, "literal"))
    marks = {line.get_marker() for line in sheet.axes[0].lines}
    (legend,) = sheet.legends
    assert legend.legend_handles and all(handle.get_marker() in marks for handle in legend.legend_handles)


def test_a_unit_that_the_name_of_the_metric_has_already_is_not_said_twice(material: Material) -> None:
    figure = declared(kind="sweep", over="rate", metric="cond_S", y={"label": "improvement (%)", "unit": "%"})
    sheet = drawn(figure, points(figure, material, "literal"))
    assert sheet.axes[0].get_ylabel() == "improvement (%)"


def test_a_declared_axis_is_kept(material: Material) -> None:
    axis = {"log": True, "label": "condition number", "unit": "m", "limits": [0.5, 50.0]}
    figure = declared(kind="sweep", over="rate", metric="cond_S", y=axis, x={"times": 100.0, "unit": "%"})
    (ax,) = drawn(figure, points(figure, material, "literal")).axes
    assert (ax.get_yscale(), ax.get_ylim(), ax.get_ylabel()) == ("log", (0.5, 50.0), "condition number (m)")
    assert ax.get_xlabel() == "rate (%)"
    assert max(line.get_xdata().max() for line in ax.lines) == pytest.approx(40.0)


def test_an_infinite_median_points_out_of_the_panel() -> None:
    figure = declared(kind="sweep", over="rate", metric="rmse")
    found = [Point("ours", "", "", "kf", "rmse", x, y) for x, y in ((1, 2.0), (2, math.inf))]
    (ax,) = drawn(figure, found).axes
    assert [line.get_xdata().tolist() for line in ax.lines if line.get_marker() == "^"] == [[2.0]]


def test_an_interval_without_an_upper_end_reaches_up_to_the_mark() -> None:
    figure = declared(kind="sweep", over="rate", metric="rmse", statistic="median")
    bounded, open_ = (1, 2.0, 1.0, 4.0), (2, 3.0, 2.0, math.inf)
    found = [Point("ours", "", "", "kf", "rmse", *numbers) for numbers in (bounded, open_)]
    (ax,) = drawn(figure, found).axes
    (bars,) = ax.collections
    assert [segment[:, 1].tolist() for segment in bars.get_segments()] == [[1.0, 4.0], [2.0, 3.0]]
    assert "without a cap where it has no end" in caption(figure, found)


def test_the_caption_of_medians_says_that_failed_runs_count(material: Material) -> None:
    figure = declared(kind="bars", metric="err_norm", statistic="median", cases=["rate=0.4"], filters=["kf"])
    text = caption(figure, points(figure, material, "root"))
    assert "whiskers: 95 % interval between two of the runs" in text
    assert "Runs failed (infinite in medians) or lost." in text


def test_swept_words_stand_in_their_order() -> None:
    figure = declared(kind="sweep", over="coin", metric="rmse")
    found = [Point("ours", "", "", "kf", "rmse", x, 1.0) for x in ("joint", "component")]
    (ax,) = drawn(figure, found).axes
    assert [tick.get_text() for tick in ax.get_xticklabels()] == ["joint", "component"]


def test_the_caption_says_what_over_how_many_runs_and_where(material: Material) -> None:
    figure = declared(kind="curve", metric="err_norm@k", cases=["rate=0.4"], title="Error norm (82)")
    text = caption(figure, points(figure, material, "root")).replace("\u00a0", " ")
    lost = int(material.results.lost("root", "rate=0.4", "kf").sum())
    assert text == (
        "Error norm (82). Mean of error norm over 60 runs at each step; band: ± 2 standard errors. "
        f"Case rate = 0.4. Reading root. Runs failed (left out of means) or lost. KF: {lost} lost."
    )


def test_every_panel_of_a_wrapped_line_says_whose_it_is(material: Material) -> None:
    four = ["clairvoyant_kf", "kf", "hkf", "aladkf"]
    figure = declared(kind="panels", metric="err_norm@k", cases=["rate=0.4"], filters=four)
    sheet = drawn(figure, points(figure, material, "literal"))
    assert [ax.get_title(loc="left") for ax in sheet.axes] == ["clairvoyant KF", "KF", "HKF", "ALADKF"]


def test_a_curve_of_root_mean_squares_is_not_called_a_mean(material: Material) -> None:
    figure = declared(kind="curve", metric="rmse@k", cases=["rate=0.4"])
    text = caption(figure, points(figure, material, "literal"))
    assert text.startswith("RMSE: root of the mean square over 60 runs at each step; band: ± 2 standard errors.")
    mixed = averaged(["mean", "median"], ["err_norm", "pooled_rmse"])
    assert mixed == "Mean and median of error norm, pooled RMSE (mean of pooled RMSE: root of the mean square)"


def test_the_cases_of_a_figure_stand_in_the_order_in_which_they_are_named(material: Material) -> None:
    figure = declared(kind="bars", metric="err_norm", cases=["rate=0.3", "rate=0.05", "rate=0.3"])
    shown = [point.case for point in points(figure, material, "literal") if point.filter == "kf"]
    assert shown == ["rate=0.3", "rate=0.05"]


def test_names_that_the_scenario_gives_are_read_everywhere(material: Material) -> None:
    words = Words({"rate": "share of outliers", "kf": "my KF", "err_norm": "error"})
    figure = declared(kind="curve", metric="err_norm@k", cases=["rate=0.4"], filters=["kf", "hkf"])
    found = points(figure, material, "root")
    text = caption(figure, found, words).replace("\u00a0", " ")
    assert "Mean of error over 60 runs" in text
    assert "Case share of outliers = 0.4." in text
    sheet = figures.draw(figure, found, style.looks(["kf", "hkf"]), words=words)
    assert [each.get_text() for each in sheet.legends[0].get_texts()] == ["my KF", "HKF"]
    assert sheet.axes[0].get_ylabel() == "error"


def test_a_name_that_says_it_is_a_case_needs_no_word_before_it(material: Material) -> None:
    figure = declared(kind="curve", metric="err_norm@k", cases=["rate=0.2", "rate=0.4"], filters=["kf"])
    words = Words({"rate=0.2": "case 2", "rate=0.4": "case 4"})
    assert "Case 2; case 4." in caption(figure, points(figure, material, "root"), words).replace("\u00a0", " ")
