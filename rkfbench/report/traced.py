"""What `rkfbench trace` writes: one run as CSV and as one figure."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench.report import style
from rkfbench.report.words import PLAIN
from rkfbench.store import files
from rkfbench.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDE = 2  # panels side by side
CAPTION = (
    "States: truth black, dots: measured directly. Estimates and errors with ± 2 of the standard deviations that the "
    "filter states, innovations with ± 2 roots of S. Crosses: outliers, as the simulation knows them."
)


def names(trace: Trace) -> list[str]:
    """<case>.<filter>.run<N> as csv, png and pdf."""
    words = [trace.case, trace.filter, f"run{trace.run}"]
    stem = ".".join(files.slug(word) for word in words if word)
    return [f"{stem}{suffix}" for suffix in (".csv", ".png", ".pdf")]


def write(folder: Path, trace: Trace) -> list[Path]:
    """Write the three; the files written."""
    paths = [folder / name for name in names(trace)]
    files.write_csv(paths[0], list(trace.columns), trace.rows())
    with style.styled():
        sheet = draw(trace)
        files.write(paths[1], style.png(sheet))
        sheet.set_layout_engine("none")
        files.write(paths[2], style.pdf(sheet))
    return paths


def draw(trace: Trace) -> Figure:
    """Panels of the states and their errors, the innovations, and what else the filter shows (inside
    `style.styled()`).
    """
    import textwrap

    from matplotlib.figure import Figure

    panels = list(_panels(trace))
    count = len(panels)
    rows = -(-count // WIDE)
    head = [style.display_name(trace.filter), PLAIN.case(trace.case), f"run {trace.run}"]
    caption = textwrap.wrap(f"{', '.join(each for each in head if each)}. {CAPTION}", 120)
    sheet = Figure(figsize=(7.0, 1.7 * rows + 0.3 + 0.16 * len(caption)), layout="constrained")
    axes = sheet.subplots(rows, WIDE, squeeze=False, sharex=True).ravel()
    for spare in axes[count:]:
        spare.set_visible(False)
    look = style.looks([trace.filter])[trace.filter]
    for ax, (panel, name) in zip(axes, panels, strict=False):
        panel(ax, trace, name, look)
    for ax in axes[max(count - WIDE, 0) : count]:
        ax.set_xlabel("t" if "t" in trace.columns else "step k")
        ax.tick_params(labelbottom=True)
    sheet.supxlabel("\n".join(caption), fontsize=7.5, color="#333333", x=0.01, ha="left")
    return sheet


def _panels(trace: Trace) -> Iterator[tuple[Callable[[Axes, Trace, str, style.Look], None], str]]:
    for name in trace.states:
        yield _state, name
        if f"x_{name}" in trace.columns:
            yield _error, name
    for name in trace.measurements:
        if f"nu_{name}" in trace.columns:
            yield _innovation, name
    for name in trace.shown:
        yield _history, name


def _x(trace: Trace) -> Any:
    return trace.columns.get("t", trace.columns["k"])


def _state(ax: Axes, trace: Trace, name: str, look: style.Look) -> None:
    x, columns = _x(trace), trace.columns
    if f"x_{name}" in columns:
        ax.plot(x, columns[f"x_{name}"], color="black", linewidth=0.9)
    if f"y_{name}" in columns:
        outlying = _outliers(trace, name)
        y = columns[f"y_{name}"]
        ax.plot(x, np.where(outlying, np.nan, y), linestyle="", marker=".", markersize=2.5, color=style.GREY, zorder=1)
    mean, sd = columns[f"xhat_{name}"], columns.get(f"sd_{name}")
    ax.plot(x, mean, color=look.colour)
    if sd is not None:
        ax.fill_between(x, mean - 2 * sd, mean + 2 * sd, color=look.colour, alpha=0.15, linewidth=0)
    ax.set_title(name)


def _error(ax: Axes, trace: Trace, name: str, look: style.Look) -> None:
    x, sd = _x(trace), trace.columns.get(f"sd_{name}")
    ax.plot(x, trace.columns[f"xhat_{name}"] - trace.columns[f"x_{name}"], color=look.colour, linewidth=0.8)
    if sd is not None:
        ax.fill_between(x, -2 * sd, 2 * sd, color=look.colour, alpha=0.15, linewidth=0)
    ax.set_title(f"error of {name}")


def _innovation(ax: Axes, trace: Trace, name: str, look: style.Look) -> None:
    x, nu = _x(trace), trace.columns[f"nu_{name}"]
    ax.plot(x, nu, color=look.colour, linewidth=0.8)
    if (S := trace.columns.get(f"S_{name}_{name}")) is not None:
        root = 2 * np.sqrt(S)
        ax.fill_between(x, -root, root, color=look.colour, alpha=0.15, linewidth=0)
    outlying = _outliers(trace, name)
    ax.plot(x[outlying], nu[outlying], linestyle="", marker="x", markersize=4, color=style.RED)
    ax.set_title(f"innovation of {name}")


def _history(ax: Axes, trace: Trace, name: str, look: style.Look) -> None:
    columns = trace.shown[name]
    for column in columns:
        ax.plot(_x(trace), trace.columns[column], linewidth=0.8, label=column.removeprefix(f"{name}_"))
    if len(columns) > 1:
        ax.legend(fontsize=6.5, ncols=len(columns), loc="lower right", bbox_to_anchor=(1, 1))  # beside the title
    ax.set_title(name.replace("_", " "))


def _outliers(trace: Trace, name: str) -> Any:
    flags = trace.columns.get(f"outlier_{name}", trace.columns.get("outlier"))
    return np.zeros(len(trace.columns["k"]), bool) if flags is None else flags.astype(bool)
