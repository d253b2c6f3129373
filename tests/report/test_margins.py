"""Panels in their places: all that is written lies on the sheet, and nothing beside a panel meets another panel."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rkfbench.report import style
from rkfbench.report.margins import _Reach, place
from rkfbench.report.ticks import plain_ticks

TITLES = ("L25: shots on w and v, j among them", "C25: no shots, j = 25", "of", "")
LABELS = ("RMSE [altitude] (ft)", "MSE of tracking runs\n[px, py]")
WIDTH, CAPTION = 7.0, 0.6


def sheet_of(rows: int, columns: int, high: float, log: bool) -> tuple[Figure, Any]:
    body = 0.35 + 1.75 * rows
    sheet = Figure(figsize=(WIDTH, body + CAPTION))
    axes = sheet.subplots(rows, columns, squeeze=False, sharex=True)
    for number, ax in enumerate(axes.flat):
        if log:
            ax.set_yscale("log")
        ax.plot([1, 100], [0.3, high], label=f"filter {number}")
        plain_ticks(ax)
        ax.set_title(TITLES[number % len(TITLES)])
        ax.set_xlabel("step k")
        if number % columns == 0:
            ax.set_ylabel(LABELS[number % len(LABELS)])
    sheet.legend(ncols=3)
    place(sheet, axes, body, style.DPI)
    return sheet, axes


@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (2, 2), (2, 6), (4, 3)])
@pytest.mark.parametrize(("high", "log"), [(7.0, False), (9e6, False), (20.0, True), (1e12, True)])
def test_what_is_written_lies_on_the_sheet_and_apart(rows: int, columns: int, high: float, log: bool) -> None:
    with style.styled():
        sheet, axes = sheet_of(rows, columns, high, log)
        renderer = FigureCanvasAgg(sheet).get_renderer()
        sheet.draw(renderer)
        body = sheet.bbox.frozen()
        body.y0 += CAPTION * style.DPI
        boxes = [ax.get_tightbbox(renderer) for ax in axes.flat] + [sheet.legends[0].get_window_extent(renderer)]
    slack = 0.02 * style.DPI
    for box in boxes:
        assert box.x0 > body.x0 - slack and box.x1 < body.x1 + slack, "beyond the left or right edge"
        assert box.y0 > body.y0 - slack and box.y1 < body.y1 + slack, "beyond the upper edge or in the caption"
    for one, other in combinations(boxes, 2):
        across = min(one.x1, other.x1) - max(one.x0, other.x0)
        along = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert min(across, along) < 2 * slack, "two panels, or a panel and the legend, meet"


def test_panels_have_one_size_and_their_labels_stand_in_line() -> None:
    with style.styled():
        _, axes = sheet_of(3, 2, 1e4, log=False)
    sizes = np.array([ax.get_position().size for ax in axes.flat])
    np.testing.assert_allclose(sizes, sizes[:1].repeat(6, axis=0))
    assert len({ax.yaxis.label.get_position()[0] for ax in axes[:, 0]}) == 1


@pytest.mark.parametrize("share", ["all", "row", "none"])
def test_what_panels_share_is_measured_once_and_true_of_each(share: Any) -> None:
    with style.styled():
        sheet = Figure(figsize=(WIDTH, 5.0))
        axes = sheet.subplots(2, 3, squeeze=False, sharex=True, sharey=share)
        for number, ax in enumerate(axes.flat):
            ax.plot([1, 98], [0, 10.0**number])
        place(sheet, axes, 4.4, style.DPI)
        renderer: Any = FigureCanvasAgg(sheet).get_renderer()
        once = _Reach(renderer)
        for ax in axes.flat:
            for axis in (ax.xaxis, ax.yaxis):
                np.testing.assert_allclose(once(ax, axis), _Reach(renderer)(ax, axis), atol=1e-9)
        assert len(once.found) == 1 + {"all": 1, "row": 2, "none": 6}[share]


def test_ticks_of_few_decades_are_plain_numbers() -> None:
    with style.styled():
        sheet, axes = sheet_of(1, 1, 2.0, log=True)
        sheet.draw(FigureCanvasAgg(sheet).get_renderer())
        shown = [label.get_text() for label in axes[0, 0].get_yticklabels(which="both")]
    assert {"0.4", "0.6", "1", "2"} <= set(shown)
