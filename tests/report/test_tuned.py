"""What tune and trace draw."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from rkfbench.report import style, traced, tuned
from rkfbench.scenario import load
from rkfbench.study.axes import axis
from rkfbench.study.tune import tune
from rkfbench.trace import trace

HKF = {"use": "hkf", "label": "hkf", "threshold": 1.345, "root": "symmetric", "reuse_root": True}


def sensitivity(scenario: Path, *over: str) -> Figure:
    found = tune(load(scenario).cells[-1], HKF, [axis(each, HKF, 3) for each in over], "err_norm", seed=5, runs=5)
    with style.styled():
        sheet = tuned.draw([found], "hkf", "err_norm")
        style.png(sheet)  # lays it out
    return sheet


def test_categories_have_marks_with_bars_and_nothing_between_them(small: Path) -> None:
    (ax,) = sensitivity(small, "root=symmetric,cholesky").axes
    joined = [line for line in ax.lines if line.get_linestyle() not in ("None", "") and len(line.get_xdata()) > 2]
    assert joined == []
    assert [len(bars.get_segments()) for bars in ax.collections] == [2, 1, 1]  # both roots, as chosen, as before
    names, panel = [label.get_window_extent() for label in ax.get_xticklabels()], ax.get_window_extent()
    assert all(panel.x0 <= name.x0 and name.x1 <= panel.x1 for name in names)


def test_numbers_are_joined_by_a_curve_with_a_band(small: Path) -> None:
    (ax,) = sensitivity(small, "threshold=1,2,3").axes
    curve = ax.lines[0]
    assert (curve.get_linestyle(), len(curve.get_xdata())) == ("-", 3)


def test_a_caption_is_no_wider_than_its_figure(small: Path) -> None:
    sheet = sensitivity(small, "root=symmetric,cholesky", "reuse_root=true,false", "threshold=1,2,3")
    assert sheet._supxlabel.get_window_extent().x1 <= sheet.bbox.x1


def test_the_legend_of_a_weight_stands_above_its_panel(small: Path) -> None:
    found = trace(load(small).cells[-1], 5, 3, "hkf")
    with style.styled():
        sheet = traced.draw(found)
        style.png(sheet, dpi=40)
    (ax,) = (ax for ax in sheet.axes if ax.get_legend())
    legend = ax.get_legend()
    assert legend is not None
    assert legend.get_window_extent().y0 >= ax.get_window_extent().y1
