"""Ticks of logarithmic axes as a reader wants them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.ticker import LogFormatter, NullLocator

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class Plain(LogFormatter):
    """0.6 where Matplotlib writes 6e-01."""

    def __call__(self, x: float, pos: Any = None) -> str:
        return f"{x:g}" if super().__call__(x, pos) else ""


def plain_ticks(ax: Axes) -> None:
    """On a logarithmic axis of few decades plain numbers, 0.5 2 10, instead of powers of ten; on one of many decades
    no ticks between these, which nobody could tell apart and which take most of the time of drawing.
    """
    for axis, scale, (low, high) in (
        (ax.xaxis, ax.get_xscale(), sorted(ax.get_xlim())),
        (ax.yaxis, ax.get_yscale(), sorted(ax.get_ylim())),
    ):
        if scale == "log" and high >= 1e3 * low:
            axis.set_minor_locator(NullLocator())
        elif scale == "log" and low >= 1e-3 and high < 1e5:
            axis.set_major_formatter(Plain())
            axis.set_minor_formatter(Plain(minor_thresholds=(1.5, 0.5)))
