"""The marks of each kind of figure in one panel: curves, sweeps, runs and bars, each with its Monte Carlo error."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench.report import style
from rkfbench.report.material import distinct
from rkfbench.report.points import Point
from rkfbench.report.style import Look
from rkfbench.report.words import Words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Looks = Mapping[str, Look]
HUGE = 1e100  # larger values cannot be drawn to scale and count as infinite, their inverses as 0
BESIDE: dict[str, Any] = {"linestyle": style.DOTTED, "marker": "", "linewidth": 1.0}
PATH: dict[str, Any] = {"linestyle": style.SOLID, "marker": "", "linewidth": 0.5}  # a single run: too rough for dashes
CHARACTERS = 15  # of the name of a group of bars, an inch
BEFORE = (0.18, 0.03)  # where marks stand at the left of the steps, in ranges of these
PRINTED: dict[str, Any] = {
    "linestyle": "",
    "marker": "D",
    "markersize": 5,
    "color": "black",
    "markerfacecolor": "white",
}


def _curves(ax: Axes, figure: Any, points: Sequence[Point], looks: Looks, words: Words) -> None:
    """Lines against the step with their band of +-2 standard errors; markers a few times a line, staggered. What is
    known before the first step stands at its left, side by side.
    """
    filters = distinct(point.filter for point in points)
    path = getattr(figure, "statistic", "") == "first"
    for order, label in enumerate(filters):
        look = looks[label]
        mine = [point for point in points if point.filter == label]
        for role in ("band", "ours", "beside"):
            chosen = sorted((point for point in mine if point.role == role), key=_x)
            if not chosen:
                continue
            x, y, low, high = _arrays(chosen, figure.x.times, figure.y.times)
            if role == "band":
                colour, alpha, above = (style.GREY, 0.45, 3) if path else (look.colour, 0.12, 1)
                ax.fill_between(x, -y, y, color=colour, alpha=alpha, linewidth=0, zorder=above)
                continue
            step = max(len(x) // 8, 1)
            every = (order * step // max(len(filters), 1), step) if len(x) > 12 else None
            _band(ax, x, low, high, look)
            ax.plot(
                x,
                _finite(y),
                markevery=every,
                **line_style(look) | (BESIDE if role == "beside" else PATH if path else {}),
            )
            _arrows(ax, x, y, look)
    _before(ax, figure, points, looks)


def _before(ax: Axes, figure: Any, points: Sequence[Point], looks: Looks) -> None:
    """A hollow mark a filter with its bar of +-2 standard errors, where no step is."""
    before = [point for point in points if point.role == "before"]
    steps, _, _, _ = _arrays([point for point in points if point.role == "ours"], figure.x.times, figure.y.times)
    if not before or not steps.size:
        return
    first, last = steps.min(), steps.max()
    places = first - (last - first) * np.linspace(*BEFORE, len(before))
    for place, point in zip(places, before, strict=True):
        _, y, low, high = _arrays([point], figure.x.times, figure.y.times)
        x, look = np.array([place]), looks[point.filter]
        ax.plot(x, _finite(y), **run_style(look))
        _bars_of_error(ax, x, y, low, high, look)
        _arrows(ax, x, y, look)
    ax.set_xticks([tick for tick in ax.get_xticks() if first <= tick <= last])


def _sweep(ax: Axes, figure: Any, points: Sequence[Point], looks: Looks, words: Words) -> None:
    """Marks with bars of +-2 standard errors, joined by lines; filters without the parameter are horizontal."""
    xs = distinct(point.x for point in points if point.role == "ours")
    places: dict[Any, float] = {}
    if any(isinstance(x, str) for x in xs):
        places = {x: float(i) for i, x in enumerate(xs)}
        ax.set_xticks(list(places.values()), [str(x) for x in xs])
    for order, label in enumerate(distinct(point.filter for point in points)):
        look = looks[label]
        mine = [point for point in points if point.filter == label and point.role == "ours"]
        chosen = sorted((p._replace(x=places.get(p.x, p.x)) for p in mine), key=_x)
        if chosen:
            x, y, low, high = _arrays(chosen, figure.x.times, figure.y.times)
            ax.plot(x, _finite(y), **line_style(look))
            _bars_of_error(ax, x, y, low, high, look)
            if figure.whiskers:
                sd = np.array([math.nan if p.sd is None else p.sd for p in chosen]) * figure.y.times
                _bars_of_error(ax, x, y, y - sd, y + sd, look, thin=True)
            _arrows(ax, x, y, look)
        for point in points:
            if point.filter == label and point.role == "level" and abs(point.y) < HUGE:
                across = np.linspace(0, 1, 13)  # of the panel's width
                height = np.full(across.size, point.y * figure.y.times)
                every = (2 + order % 3, 4)
                ax.plot(across, height, transform=ax.get_yaxis_transform(), markevery=every, **line_style(look))
                if point.low is not None and point.high is not None and abs(point.high) < HUGE:
                    low_, high_ = point.low * figure.y.times, point.high * figure.y.times
                    ax.axhspan(low_, high_, color=look.colour, alpha=0.15, linewidth=0)


def _runs(ax: Axes, figure: Any, points: Sequence[Point], looks: Looks, words: Words) -> None:
    """One mark a run; a thin line at the mean of the marks."""
    for label in distinct(point.filter for point in points):
        look = looks[label]
        x, y, _, _ = _arrays([p for p in points if p.filter == label], figure.x.times, figure.y.times)
        ax.plot(x, _finite(y), **run_style(look))
        if np.isfinite(y).any():
            ax.axhline(float(np.mean(y[np.isfinite(y)])), linestyle=look.dash, color=look.colour, linewidth=0.8)
        _arrows(ax, x, y, look)


def mark_style(look: Look) -> dict[str, Any]:
    """A mark in the place of a bar, which on a logarithmic axis would begin nowhere."""
    return line_style(look) | {"linestyle": "", "marker": look.marker or "_"}


def _bars(ax: Axes, figure: Any, points: Sequence[Point], looks: Looks, words: Words) -> None:
    """One bar a filter in groups by case, hatched to be told apart in grey; the paper's numbers are open diamonds."""
    cases = distinct(point.case for point in points)
    filters = distinct(point.filter for point in points)
    width = 0.8 / len(filters)
    for order, label in enumerate(filters):
        look = looks[label]
        for role in ("ours", "paper"):
            chosen = [point for point in points if point.filter == label and point.role == role]
            if not chosen:
                continue
            x = np.array([cases.index(p.case) + (order - (len(filters) - 1) / 2) * width for p in chosen])
            _, y, low, high = _arrays([p._replace(x=0.0) for p in chosen], 1.0, figure.y.times)
            if role == "paper":
                ax.plot(x, _finite(y), zorder=4, **PRINTED)
                continue
            if ax.get_yscale() == "log":
                ax.plot(x, _finite(y), **mark_style(look))
            else:
                ax.bar(x, _finite(y), width * 0.92, **bar_style(look, order))
            _bars_of_error(ax, x, y, low, high, Look("#222222", ""))
            _arrows(ax, x, y, look)
    room = ax.get_window_extent().width / ax.figure.get_dpi() / len(cases)  # inches for a group
    names = [textwrap.fill(words.case(case) or "all", max(8, int(CHARACTERS * room))) for case in cases]
    ax.set_xticks(range(len(cases)), names)
    ax.grid(visible=False, axis="x")


KINDS: dict[str, Callable[[Any, Any, Sequence[Point], Looks, Words], None]] = {
    "curve": _curves, "panels": _curves, "sweep": _sweep, "runs": _runs, "bars": _bars, "influence": _curves,
}  # fmt: skip


def _arrays(points: Sequence[Point], times_x: float, times_y: float) -> tuple[Any, Any, Any, Any]:
    """x, y, low, high of points as float arrays, in the units of the axes; NaN where there is none."""
    columns = ([math.nan if v is None else float(v) for v in (p.x, p.y, p.low, p.high)] for p in points)
    x, y, low, high = np.array(list(columns), float).reshape(-1, 4).T * [[times_x], [times_y], [times_y], [times_y]]
    low, high = (np.where(np.abs(end) < HUGE, end, np.nan) for end in (low, high))
    y[np.abs(y) >= HUGE] *= math.inf
    y[np.abs(y) <= 1 / HUGE] = 0.0
    return x, y, low, high


def _x(point: Point) -> Any:
    return point.x


def _finite(y: Any) -> Any:
    return np.where(np.isfinite(y), y, np.nan)


def line_style(look: Look) -> dict[str, Any]:
    """Colour, dash, marker, width and depth of a filter's line; references are thin and lie behind."""
    width, depth = (1.0, 2) if look.reference else (1.3, 3)
    return {"color": look.colour, "linestyle": look.dash, "marker": look.marker, "linewidth": width, "zorder": depth}


def run_style(look: Look) -> dict[str, Any]:
    """A hollow mark without a line, as marks of single runs overlap."""
    return line_style(look) | {"linestyle": "", "marker": look.marker or ".", "markerfacecolor": "none"}


def bar_style(look: Look, order: int) -> dict[str, Any]:
    """The n-th bar of a group: a lighter tone of the filter's colour, and a hatch that can be told apart in grey."""
    hatch = style.HATCHES[order % len(style.HATCHES)]
    return {"facecolor": style.blend(look.colour, 0.35), "edgecolor": "#222222", "linewidth": 0.6, "hatch": hatch}


def _band(ax: Axes, x: Any, low: Any, high: Any, look: Look) -> None:
    if np.isfinite(low).any():
        low = np.maximum(low, high / 1e3) if ax.get_yscale() == "log" else low
        ax.fill_between(x, low, high, color=look.colour, alpha=0.22, linewidth=0)


def _bars_of_error(ax: Axes, x: Any, y: Any, low: Any, high: Any, look: Look, thin: bool = False) -> None:
    """A bar from low to high, with caps; one without a finite upper end reaches up to the mark."""
    there = np.isfinite(y) & np.isfinite(low)
    if there.any():
        low = np.fmax(low, high / 1e3) if ax.get_yscale() == "log" else low
        x, y, low, high = x[there], y[there], low[there], high[there]
        width, cap = (0.6, 4) if thin else (1.2, 6)
        ax.vlines(x, low, np.where(np.isfinite(high), high, y), color=look.colour, linewidth=width, zorder=3)
        for end in (low, high):
            ax.plot(x, end, linestyle="", marker="_", markersize=cap, color=look.colour, markeredgewidth=width)


def _arrows(ax: Axes, x: Any, y: Any, look: Look) -> None:
    """An infinite mean or median (more than half of the runs failed) points out of the panel."""
    for sign, marker, height in ((1, "^", 0.97), (-1, "v", 0.03)):
        there = x[np.isinf(y) & (np.sign(y) == sign)]
        if there.size:
            transform = ax.get_xaxis_transform()
            ax.plot(there, np.full(there.size, height), marker, color=look.colour, transform=transform, clip_on=False)
