"""Forest rows: claims as intervals against their claimed regions, each on a scale of its own.

Claims have different units, so every row has its own axis: it spans the interval, the estimate and the finite edges of
the region with some room. What the eye compares is where the interval lies: in the region, outside, or across its edge.
A row is the cell that decides its claim (see `deciding`).
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rkfbench.claims.verdict import Holds, decisive
from rkfbench.claims.words import among
from rkfbench.report import style
from rkfbench.report.material import distinct, text
from rkfbench.report.numbers import written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Row = Mapping[str, Any]
COLUMNS = (
    "claim", "reading", "estimand", "cells", "estimate", "se", "lower", "upper", "region_low", "region_high", "printed",
    "verdict", "flip", "flip_percent", "runs",
)  # fmt: skip
ROOM = 0.12  # of the span, at both ends
TOP, FOOT = 0.15, 0.25  # inches
MARKS = {"reproduced": "●", "not reproduced": "✕", "inconclusive": "◇"}  # any other verdict: a dash
VERDICT_COLOURS = {"reproduced": style.BLUE, "not reproduced": style.RED}  # any other verdict: grey


@dataclass(frozen=True)
class Line:
    """One row: the deciding cell of a claim under a reading. `at` to `edges` are places, 0 left and 1 right."""

    claim: str
    reading: str
    estimand: str
    verdict: str
    estimate: str
    claimed: str
    cells: int
    at: float | None
    lower: float | None
    upper: float | None
    region: tuple[float, float]
    edges: tuple[tuple[float, str], ...]  # the finite edges of the region with their numbers
    row: Row
    among: str  # what all cells say
    rests_on: str = ""  # what the reader should know of the cells behind the verdict

    @property
    def record(self) -> Row:
        """The line as a record of the CSV behind the figure."""
        return {**self.row, "cells": self.cells}


def lines(
    rows: Iterable[Row],
    claims: Sequence[str] | None = None,
    readings: Sequence[str] | None = None,
    holds: Mapping[str, Holds] = MappingProxyType({}),
) -> list[Line]:
    """The deciding cells of `claims` under `readings`, from rows of claims.csv; default: all that there are.

    holds: claim -> whether it holds if all of its cells do, or any; default: all.
    """
    chosen = [row for row in rows if row["role"] == "decides"]
    order = claims or distinct(text(row["claim"]) for row in chosen)
    found = []
    for claim in order:
        for reading in distinct(text(row["reading"]) for row in chosen):
            cells = [row for row in chosen if (text(row["claim"]), text(row["reading"])) == (claim, reading)]
            if cells and (readings is None or reading in readings):
                found.append(line(cells, holds.get(claim, "all")))
    return found


def deciding(cells: Sequence[Row], holds: Holds = "all") -> Row:
    """The cell that decides a claim (see `decisive`)."""
    margins = [_finite(row.get("flip_percent")) or 0.0 for row in cells]
    return cells[decisive([(row["verdict"], margin) for row, margin in zip(cells, margins, strict=True)], holds)]


def line(cells: Sequence[Row], holds: Holds = "all") -> Line:
    """The cell that decides a claim, of these rows of claims.csv, placed on its own scale."""
    row = deciding(cells, holds)
    printed = row.get("printed") if row.get("printed_runs") else None
    low, high = (printed, printed) if printed is not None else (row.get("region_low"), row.get("region_high"))
    estimate, lower, upper = (_finite(row.get(name)) for name in ("estimate", "lower", "upper"))
    edges = distinct(edge for edge in (_finite(low), _finite(high)) if edge is not None)
    error = None if row.get("law") == "exact" else _finite(row.get("se"))
    known = [value for value in (estimate, lower, upper, *edges) if value is not None]
    claimed = f"claimed {row['claimed']}" if row.get("claimed") else ""
    span = (min(known), max(known)) if known else (0.0, 1.0)
    room = ROOM * (span[1] - span[0]) or abs(span[0]) * ROOM or 1.0
    start, width = span[0] - room, span[1] - span[0] + 2 * room

    def place(value: float) -> float:
        return min(max((value - start) / width, 0.0), 1.0)

    return Line(
        text(row["claim"]),
        text(row["reading"]),
        text(row["estimand"]),
        row["verdict"],
        "–" if estimate is None else written(estimate, error).text(),
        f"printed {printed:.6g}" if printed is not None else claimed,
        len(cells),
        None if estimate is None else place(estimate),
        None if lower is None else place(lower),
        None if upper is None else place(upper),
        (place(-math.inf if low is None else low), place(math.inf if high is None else high)) if edges else (0.0, 0.0),
        tuple((place(edge), f"{edge:.4g}") for edge in edges),
        row,
        among([each["verdict"] for each in cells], holds),
    )


def size(found: Sequence[Line]) -> tuple[float, float]:
    """Width and height of the rows in inches; a caption stands below them."""
    return 7.0, TOP + FOOT + 0.44 * len(found)


def draw(found: Sequence[Line], caption: str = "") -> Figure:
    """The rows as a figure (inside `style.styled()`): region shaded, interval as a bar, verdict as shape and word."""
    from matplotlib.figure import Figure

    below = textwrap.wrap(caption, 118)
    width, body = size(found)
    foot = FOOT + 0.155 * len(below)
    height = body - FOOT + foot
    sheet = Figure(figsize=(width, height))
    ax = sheet.add_axes((0.30, foot / height, 0.34, (height - TOP - foot) / height))
    ax.set(xlim=(0, 1), ylim=(len(found) - 0.5, -0.5), xticks=[], yticks=[])
    ax.spines[:].set_visible(False)
    ax.grid(visible=False)
    markers = {"reproduced": "o", "not reproduced": "X", "inconclusive": "D"}
    beside = ax.get_yaxis_transform()
    for y, each in enumerate(found):
        colour = VERDICT_COLOURS.get(each.verdict, style.GREY)
        ax.fill_betweenx([y - 0.3, y + 0.3], *each.region, color="#E4E7EB", linewidth=0)
        for place, number in each.edges:
            ax.plot([place, place], [y - 0.3, y + 0.3], color="#555555", linewidth=0.8)
            ax.text(place, y + 0.33, number, fontsize=6, color="#555555", ha="center", va="top")
        if each.lower is not None and each.upper is not None:
            ax.plot([each.lower, each.upper], [y, y], color=colour, linewidth=2, solid_capstyle="butt")
        if each.at is not None:
            fill = colour if each.verdict == "reproduced" else "white"
            ax.plot(each.at, y, markers.get(each.verdict, "_"), color=colour, markerfacecolor=fill, markersize=6)
        ax.text(-0.03, y - 0.13, each.claim, transform=beside, ha="right", va="center", weight="bold", fontsize=8)
        named = [each.reading] if each.reading not in ("", "default") else []
        named += [each.among] if each.among else []
        ax.text(-0.03, y + 0.2, "; ".join(named), transform=beside, ha="right", va="center", fontsize=6.5)
        shown = "".join([each.estimate, f", {each.claimed}" if each.claimed else ""])
        ax.text(1.03, y - 0.13, each.verdict, transform=beside, va="center", color=colour, weight="bold", fontsize=8)
        ax.text(1.03, y + 0.2, shown, transform=beside, va="center", fontsize=6.5)
    if below:
        sheet.text(0.01, 0.06 / height, "\n".join(below), fontsize=7.5, color="#333333", va="bottom", linespacing=1.25)
    return sheet


def _finite(value: Any) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)
