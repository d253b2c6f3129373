"""Panels in their places: margins as wide as what is written in them.

Matplotlib's constrained layout finds much the same, but measures every artist of every panel twice, which takes longer
than to draw them. Here only what stands beside a panel is measured, and once: the labels of its ticks and axes, its
title, the legend above all. Lengths are in inches.
"""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib import rcParams
from matplotlib.font_manager import FontProperties

from rkfbench.linalg import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

EDGE, GAP, PAD = 0.05, 0.12, 0.03  # of the sheet, between panels, between the labels of ticks and of their axis
CHARACTERS = 14  # of a title, an inch
LEAST = 0.3  # of a panel, however much is written beside it
POINT = 1 / 72


class Sides(NamedTuple):
    """Room beside the panels: left and right of every column, above and below every row."""

    left: Array
    right: Array
    above: Array
    below: Array


class Written(NamedTuple):
    """What stands beside one panel: how far its ticks' labels reach to the left, below and to the right, and the
    extents of the labels of its axes.
    """

    left: float
    below: float
    right: float
    x_label: float
    y_label: float


NOTHING = Written(0.0, 0.0, 0.0, 0.0, 0.0)


def place(sheet: Figure, axes: Any, body: float, dpi: int) -> None:
    """Fill the upper `body` of a sheet with its panels, axes (rows, columns), below the legend if there is one. Titles
    are wrapped to the room above their panels.

    Text is measured as it is drawn at the resolution `dpi`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    sheet.set_dpi(dpi)
    renderer: Any = FigureCanvasAgg(sheet).get_renderer()
    width, height = sheet.get_size_inches()
    top = height - EDGE
    for legend in sheet.legends:
        legend.set_loc("upper left")
        legend.set_bbox_to_anchor((EDGE / width, top / height), sheet.transFigure)
        top -= legend.get_window_extent(renderer).height / dpi + GAP
    box = EDGE, height - body + EDGE, width - EDGE, top
    rows, columns = axes.shape
    # how many ticks there are depends on how long an axis is: so first it is about as long as in the end
    _spread(axes, Sides(*(np.full(count, 0.3) for count in (columns, columns, rows, rows))), box)
    reach = _Reach(renderer)
    written = [_written(ax, renderer, reach, dpi) if ax.get_visible() else NOTHING for ax in axes.flat]
    left, below, right, x_label, y_label = np.array(written).T.reshape(-1, rows, columns)
    beside = Sides((left + y_label).max(0) + PAD, right.max(0), np.zeros(rows), (below + x_label).max(1) + PAD)
    wide, _ = _spread(axes, beside, box)
    for (_, column), ax in np.ndenumerate(axes):
        last = column + 1 == columns
        room = wide + (beside.right[column] if last else GAP + beside.left[column + 1] / 2)
        ax.set_title(textwrap.fill(ax.get_title("left"), max(8, int(CHARACTERS * room))))
    heights = np.array([_title(ax) for ax in axes.flat]).reshape(axes.shape)
    _, high = _spread(axes, beside._replace(above=heights.max(1)), box)
    for (row, column), ax in np.ndenumerate(axes):
        ax.xaxis.set_label_coords(0.5, -(below[row, column] + PAD) / high)
        ax.yaxis.set_label_coords(-(left[:, column].max() + PAD) / wide, 0.5)  # those of a column in one line
        ax.set_title(ax.get_title("left"), y=1 + _power(ax.yaxis) / high)


def _written(ax: Axes, renderer: Any, reach: _Reach, dpi: int) -> Written:
    """What stands beside a panel that is about where it will be."""
    x, y = reach(ax, ax.xaxis), reach(ax, ax.yaxis)
    x_label, y_label = (axis.label.get_window_extent(renderer) for axis in (ax.xaxis, ax.yaxis))
    return Written(y.left / dpi, x.below / dpi, x.right / dpi, x_label.height / dpi, y_label.width / dpi)


class Beyond(NamedTuple):
    """How far the labels of an axis' ticks reach beyond its panel, in pixels."""

    left: float = 0.0
    below: float = 0.0
    right: float = 0.0


class _Reach:
    """`Beyond` of an axis. Panels of one size that share an axis have the same labels, if any: they are measured once,
    as to lay out ticks takes as long as to draw them.
    """

    def __init__(self, renderer: Any) -> None:
        self.renderer = renderer
        self.found: dict[tuple[str, Axes], Beyond] = {}

    def __call__(self, ax: Axes, axis: Axis) -> Beyond:
        is_x = axis is ax.xaxis
        if not axis.get_tick_params()["labelbottom" if is_x else "labelleft"]:
            return Beyond()
        shared = ax.get_shared_x_axes() if is_x else ax.get_shared_y_axes()
        key = "x" if is_x else "y", shared.get_siblings(ax)[0]
        if key not in self.found:
            inside, labels = ax.get_window_extent(self.renderer), _ticks(axis, self.renderer)
            beyond = inside.x0 - labels.x0, inside.y0 - labels.y0, labels.x1 - inside.x1
            self.found[key] = Beyond(*(max(0.0, to) for to in beyond))
        return self.found[key]


def _spread(axes: Any, sides: Sides, box: tuple[float, float, float, float]) -> tuple[float, float]:
    """Put panels of one size into a box (x0, y0, x1, y1) of the sheet; returns their width and height."""
    x0, y0, x1, y1 = box
    rows, columns = axes.shape
    wide = max(LEAST, (x1 - x0 - (sides.left + sides.right).sum() - GAP * (columns - 1)) / columns)
    high = max(LEAST, (y1 - y0 - (sides.above + sides.below).sum() - GAP * (rows - 1)) / rows)
    starts = x0 + np.cumsum(sides.left + sides.right + wide + GAP) - sides.right - wide - GAP
    tops = y1 - np.cumsum(sides.above + sides.below + high + GAP) + sides.below + high + GAP
    for (row, column), ax in np.ndenumerate(axes):
        width, height = ax.figure.get_size_inches()
        ax.set_position((starts[column] / width, (tops[row] - high) / height, wide / width, high / height))
    return wide, high


def _ticks(axis: Axis, renderer: Any) -> Any:
    """The box around what is written at the ticks of an axis."""
    from matplotlib.transforms import Bbox

    axis.set_label_coords(0.5, 0.5)  # its own label, which otherwise would be placed by all these first
    axis.label.set_visible(False)
    box = axis.get_tightbbox(renderer)
    axis.label.set_visible(True)
    return Bbox.null() if box is None else box


def _title(ax: Axes) -> float:
    """Height of what stands above a panel."""
    title = ax.get_title("left")
    lines = (
        (title.count("\n") + 1) * _line(rcParams["axes.titlesize"]) + rcParams["axes.titlepad"] * POINT
        if title
        else 0.0
    )
    return lines + _power(ax.yaxis)


def _power(axis: Axis) -> float:
    """Height of the power of ten that all ticks of an axis have in common, which stands at its end; 0 without one."""
    return _line(rcParams["ytick.labelsize"]) if axis.get_major_formatter().get_offset() else 0.0


def _line(size: float | str) -> float:
    """Height of a line of text of this size, in points or as Matplotlib calls it."""
    return 1.2 * POINT * FontProperties(size=size).get_size_in_points()
