"""Drawing: from the points of one reading and the declaration to a matplotlib figure.

Every kind is a grid of panels; what varies among the points and is not the filter becomes rows or columns by itself.
Nothing here stops at a NaN or an infinity: a NaN leaves a gap, an infinite value is a small arrow at the panel's edge.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rkfbench.report import marks, style
from rkfbench.report.marks import Looks
from rkfbench.report.material import distinct
from rkfbench.report.points import Drawn, Point
from rkfbench.report.words import PLAIN, Words
from rkfbench.scenario.display import Axis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Key = tuple[Any, Any]  # value of the row dimension, value of the column dimension
DECADES = 3  # positive values that span more are drawn on a logarithmic axis
ROW_CHARACTERS = 24  # of a line of the name at the left of a row
WIDTH, CAPTION_LINE, CAPTION_CHARACTERS = 7.0, 0.155, 118  # inches, inches, characters a line


@dataclass(frozen=True)
class Grid:
    """Which dimension runs over the rows and columns of panels, and its values."""

    row_of: str | None
    column_of: str | None
    rows: list[Any]
    columns: list[Any]
    wrapped: bool  # one dimension laid out over several lines
    words: Words = PLAIN

    @property
    def panels(self) -> list[Key]:
        return [(row, column) for row in self.rows for column in self.columns]

    @property
    def shape(self) -> tuple[int, int]:
        if not self.wrapped:
            return len(self.rows), len(self.columns)
        wide = 2 if len(self.columns) <= 4 else 3
        return -(-len(self.columns) // wide), wide

    def name(self, which: int, panel: Key) -> str:
        """A panel's value of the row (0) or column (1) dimension as a reader sees it."""
        names: dict[str | None, Callable[[Any], str]]
        names = {"case": self.words.case, "metric": self.words.metric, "filter": self.words.filter}
        return names.get((self.row_of, self.column_of)[which], lambda _: "")(panel[which])

    def holds(self, panel: Key, point: Point) -> bool:
        """Whether a point belongs to a panel; a curve drawn beside others belongs to those of every metric."""
        for dimension, wanted in zip((self.row_of, self.column_of), panel, strict=True):
            aside = dimension == "metric" and point.role in ("beside", "band")
            if dimension and not aside and getattr(point, dimension) != wanted:
                return False
        return True


def draw(figure: Drawn, points: Sequence[Point], looks: Looks, caption: str = "", words: Words = PLAIN) -> Figure:
    """Draw the points of one reading (inside `style.styled()`); `caption` goes below the panels."""
    from matplotlib.figure import Figure

    from rkfbench.report.margins import place
    from rkfbench.report.ticks import plain_ticks

    grid = layout(figure, points, words)
    rows, columns = grid.shape
    share = figure.share or ("none" if "metric" in (grid.row_of, grid.column_of) else "all")
    lines = textwrap.wrap(caption, CAPTION_CHARACTERS if columns > 1 else CAPTION_CHARACTERS * 5 // 7)
    width, body = size(grid)
    height = body + (0.1 + CAPTION_LINE * len(lines) if lines else 0)
    sheet = Figure(figsize=(width, height))
    share_y: Any = {"all": True, "row": "row", "none": False}[share]
    axes = sheet.subplots(rows, columns, squeeze=False, sharex=True, sharey=share_y)
    for spare in axes.ravel()[len(grid.panels) :]:
        spare.set_visible(False)
    for number, (panel, ax) in enumerate(zip(grid.panels, axes.ravel(), strict=False)):
        inside = [point for point in points if grid.holds(panel, point)]
        same_axis = points if share == "all" else inside
        _scale(ax, figure, [point for point in same_axis if point.role != "band"])
        marks.KINDS[figure.kind](ax, figure, inside, looks, words)
        plain_ticks(ax)
        ax.set_title(_title(grid, panel, top=number < columns))
        if number + columns >= len(grid.panels):
            ax.set_xlabel(_axis_label(figure.x, _x_name(figure, words)))
            ax.tick_params(labelbottom=True)
        if number % columns == 0:
            ax.set_ylabel("\n".join(_left_labels(figure, grid, panel, points)))
    _legend(sheet, figure.kind, grid, points, looks, width)
    place(sheet, axes, body, style.DPI)
    if lines:
        sheet.text(0.01, 0.06 / height, "\n".join(lines), fontsize=7.5, color="#333333", va="bottom", linespacing=1.25)
    return sheet


def size(grid: Grid) -> tuple[float, float]:
    """Width and height of all panels in inches; a caption stands below them."""
    rows, columns = grid.shape
    height = 3.0 if rows * columns == 1 else 2.15 if columns < 4 else 1.75
    return WIDTH if columns > 1 else 5.0, 0.35 + rows * height


def layout(figure: Drawn, points: Sequence[Point], words: Words = PLAIN) -> Grid:
    """The grid of panels: as declared, then what else varies, columns first; one long line of panels is wrapped."""
    main = [point for point in points if point.role not in ("beside", "band")]
    values = {name: distinct(getattr(point, name) for point in main) for name in ("case", "metric", "filter")}
    row_of, column_of = figure.rows, figure.columns
    on_axis = ("case",) if figure.kind == "bars" else ()
    for name in ("case", "metric"):
        if len(values[name]) < 2 or name in (row_of, column_of, *on_axis):
            continue
        if column_of is None:
            column_of = name
        elif row_of is None:
            row_of = name
    rows = values[row_of] if row_of else [None]
    columns = values[column_of] if column_of else [None]
    return Grid(row_of, column_of, rows, columns, wrapped=len(rows) == 1 and len(columns) > 3, words=words)


def _scale(ax: Axes, figure: Drawn, points: Sequence[Point]) -> None:
    """Linear or logarithmic axes and their limits."""
    y = [point.y * figure.y.times for point in points]
    x = [point.x for point in points if not isinstance(point.x, str) and point.x is not None]
    if _logarithmic(figure.y, y):
        ax.set_yscale("log", nonpositive="mask")
    if figure.x.log or (figure.kind == "sweep" and _logarithmic(figure.x, x)):
        ax.set_xscale("log", nonpositive="mask")
    if figure.y.limits:
        ax.set_ylim(*figure.y.limits)
    if figure.x.limits:
        ax.set_xlim(*figure.x.limits)
    elif figure.kind in ("curve", "panels", "influence"):
        ax.margins(x=0.02)


def _logarithmic(axis: Axis, values: Sequence[float]) -> bool:
    finite = [value for value in values if abs(value) < marks.HUGE]
    positive = [value for value in finite if value > 1 / marks.HUGE]
    if not positive:
        return False
    if axis.log is not None:
        return axis.log
    return len(positive) == len(finite) and max(positive) > 10**DECADES * min(positive)


def _title(grid: Grid, panel: Key, top: bool) -> str:
    """Above a panel: its column. In a matrix only the top row needs it, but in a wrapped line of panels every one."""
    matrix = grid.row_of and grid.column_of and not grid.wrapped
    return grid.name(1, panel) if top or not matrix else ""


def _left_labels(figure: Drawn, grid: Grid, panel: Key, points: Sequence[Point]) -> Iterator[str]:
    """At the left of a row: its value, then what is plotted, unless a metric in row or column says that."""
    if grid.row_of:
        yield textwrap.fill(grid.name(0, panel), ROW_CHARACTERS)
    metric = next((point.metric for point in points if point.role == "ours"), "")
    name = "" if "metric" in (grid.row_of, grid.column_of) else grid.words.metric(metric)
    if label := _axis_label(figure.y, name):
        yield label


def _axis_label(axis: Axis, name: str) -> str:
    """`RMSE (m)`; a unit that the name of the metric has already is not said twice."""
    label, unit = axis.label or name, f"({axis.unit})" if axis.unit else ""
    return " ".join(filter(None, (label, "" if label.endswith(unit) else unit)))


def _x_name(figure: Any, words: Words) -> str:
    if figure.kind == "sweep":
        return words.column(figure.over)
    return {"runs": "run", "bars": "", "influence": "innovation"}.get(figure.kind, "step k")


def _legend(sheet: Figure, kind: str, grid: Grid, points: Sequence[Point], looks: Looks, width: float) -> None:
    """One legend above all panels, filters in the order in which they are drawn; none where titles name the filters."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    drawn = [p for p in points if p.role not in ("band", "paper")]
    labels = [] if "filter" in (grid.row_of, grid.column_of) else distinct(p.filter for p in drawn)
    handles: list[Any] = []
    filled = kind == "bars" and not any(ax.get_yscale() == "log" for ax in sheet.axes)
    for order, label in enumerate(labels):
        look = looks[label]
        if filled:
            handles.append(Patch(label=grid.words.filter(label), **marks.bar_style(look, order)))
        else:
            style_of = {"runs": marks.run_style, "bars": marks.mark_style}.get(kind, marks.line_style)
            line = style_of(look)
            handles.append(Line2D([], [], label=grid.words.filter(label), **line))
    beside = distinct(grid.words.metric(point.metric) for point in points if point.role == "beside")
    handles += [Line2D([], [], label=name, color=style.GREY, **marks.BESIDE) for name in beside]
    if any(point.role == "paper" for point in points):
        handles.append(Line2D([], [], label="printed in the paper", **marks.PRINTED))
    if len(handles) > 1:
        lengths = [0.6 + 0.065 * len(handle.get_label()) for handle in handles]  # inches, with the sample of the line
        fitting = len(handles) if sum(lengths) <= width else max(int(width / max(lengths)), 1)
        sheet.legend(handles=handles, ncols=fitting)
