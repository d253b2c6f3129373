"""The results of a benchmark as CSV, Markdown and a figure.

A cost is the minimum over the rounds of the CPU time. A ratio divides such minima; its range is that of the middle half
of the ratios round by round, as the rounds are interleaved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rkfbench.bench import machine
from rkfbench.bench.measure import Cost
from rkfbench.bench.peers.base import OURS
from rkfbench.report import style
from rkfbench.report.marks import line_style
from rkfbench.report.style import BLACK, BLUE, DASHDOT, DASHED, DOTTED, GREEN, LONG, ORANGE, PURPLE, RED, SKY, Look
from rkfbench.store import files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TITLES = {
    "kf": "KF, one covariance for all runs",
    "kf_own": "KF, a covariance for each run",
    "hkf": "Huber KF (HKF)",
    "aladkf": "least-absolute KF (ALADKF)",
    "ukf": "UKF",
    "ckf": "CKF",
    "pekf": "progressive EKF, 10 sub-steps",
    "pf": "bootstrap PF, 500 particles",
}
LOOKS = {
    OURS: Look(RED, "o"),
    "C": Look(BLACK, "s", DASHED),
    "C, 8 runs at once": Look(BLACK, "D", DOTTED),
    "dynamax vmap": Look(BLUE, "^", DASHDOT),
    "JAX vmap": Look(SKY, "v", LONG),
    "JAX vmap, unrolled": Look(SKY, "P", DOTTED),
    "simdkalman": Look(PURPLE, "X", DASHED),
    "FilterPy": Look(GREEN, "<", DASHED),
    "pykalman": Look(ORANGE, ">", DASHDOT),
    "Stone Soup": Look(ORANGE, "h", DOTTED),
    "NumPy loop": Look(GREEN, "d", LONG),
}
METHOD = """\
CPU time in ns a run and step, the minimum of interleaved rounds in one process; in brackets how many times the cost of
rkfbench, and the middle half of that ratio round by round. Float64, one thread (BLAS and XLA alike). All
implementations filter the same data, and their means were compared with ours before: to 1e-9 standard deviations
(dynamax, which adds 1e-9 to the diagonal of S, to 1e-5), particle filters in distribution. Loops in Python (FilterPy,
pykalman, Stone Soup, NumPy) are timed on a few runs (`timed_runs` of the CSV) and scaled. Compiling is not counted;
JAX's is in the last column."""
SHOWN = (1000, 10000)  # numbers of runs in the summary
COLUMNS = (
    "filter", "runs", "peer", "timed_runs", "steps", "rounds", "cpu_ns", "cpu_ns_median", "cpu_ns_q75", "wall_ns",
    "wall_ns_median", "ratio", "ratio_q25", "ratio_q75", "compile_s", "deviation",
)  # fmt: skip


def write(folder: Path, costs: Sequence[Cost], absent: Mapping[str, str], load: Sequence[float]) -> list[Path]:
    """bench.csv, bench.md, bench.png and bench.pdf."""
    rows = list(records(costs))
    paths = [folder / f"bench.{kind}" for kind in ("csv", "md", "png", "pdf")]
    files.write_records(paths[0], COLUMNS, rows)
    files.write(paths[1], markdown(rows, absent, load))
    with style.styled():
        sheet = figure(rows)
        files.write(paths[2], style.png(sheet))
        files.write(paths[3], style.pdf(sheet))
    return paths


def records(costs: Iterable[Cost]) -> Iterator[dict[str, Any]]:
    """One row a filter, number of runs and implementation; times in ns a run and step, ratios to ours."""
    costs = list(costs)
    ours = {(cost.filter, cost.runs): cost for cost in costs if cost.peer == OURS}
    for cost in costs:
        base = ours[cost.filter, cost.runs]
        low, high = np.quantile(cost.cpu / base.cpu, [0.25, 0.75])
        values = (
            cost.filter, cost.runs, cost.peer, cost.timed, cost.steps, len(cost.cpu), cost.cpu.min(),
            np.median(cost.cpu), np.quantile(cost.cpu, 0.75), cost.wall.min(), np.median(cost.wall),
            cost.cpu.min() / base.cpu.min(), low, high, cost.compile_s, cost.deviation,
        )  # fmt: skip
        yield {name: getattr(value, "item", lambda v=value: v)() for name, value in zip(COLUMNS, values, strict=True)}


def markdown(rows: Sequence[Mapping[str, Any]], absent: Mapping[str, str], load: Sequence[float]) -> str:
    """Facts of the machine, then one table a filter."""
    facts = {**machine.facts(), "processes that wanted to run, before and after": ", ".join(f"{x:.1f}" for x in load)}
    parts = [
        "# What a run and step costs",
        METHOD,
        "\n".join(
            [f"- {name}: {fact}" for name, fact in facts.items()] + [f"- no {n}: {why}" for n, why in absent.items()]
        ),
    ]
    if {row["runs"] for row in rows} >= {*SHOWN}:
        parts += [f"## Multiples of our cost at M = {' / '.join(map(str, SHOWN))}", summary(rows)]
    for name in dict.fromkeys(row["filter"] for row in rows):
        parts += [f"## {TITLES[name]}", _table([row for row in rows if row["filter"] == name])]
    return "\n\n".join(parts) + "\n"


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """One table for all filters: our cost, and the others' as multiples of it, at the numbers of runs in SHOWN."""
    shown = {(row["filter"], row["peer"], row["runs"]): row for row in rows if row["runs"] in SHOWN}
    present = [peer for peer in LOOKS if peer != OURS and any(key[1] == peer for key in shown)]
    lines = [["", "rkfbench, ns", *present]]
    lines.append(["---", *("---:" for _ in lines[0][1:])])
    for name in dict.fromkeys(row["filter"] for row in rows):
        cells = [TITLES[name]]
        for peer in (OURS, *present):
            own = [shown.get((name, peer, size)) for size in SHOWN]
            what = "cpu_ns" if peer == OURS else "ratio"
            cells.append(" / ".join(_short(row[what]) for row in own if row))
        lines.append(cells)
    return _lines(lines)


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    sizes = sorted({row["runs"] for row in rows})
    lines = [["", *(f"M = {size}" for size in sizes), "compile s"]]
    for peer in dict.fromkeys(row["peer"] for row in rows):
        own = {row["runs"]: row for row in rows if row["peer"] == peer}
        longest = max(row["compile_s"] for row in own.values())
        lines.append([peer, *(cell(own[size]) for size in sizes), f"{longest:.1f}" if longest else ""])
    lines.insert(1, ["---", *("---:" for _ in lines[0][1:])])
    return _lines(lines)


def _lines(lines: Iterable[Sequence[str]]) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def cell(row: Mapping[str, Any]) -> str:
    """`240 (3.2; 3.0-3.4)`."""
    cost = _short(row["cpu_ns"])
    if row["peer"] == OURS:
        return cost
    return f"{cost} ({_short(row['ratio'])}; {_short(row['ratio_q25'])}–{_short(row['ratio_q75'])})"


def _short(value: float) -> str:
    """Two or three digits, thousands apart."""
    digits = float(f"{value:.3g}")
    return f"{digits:,.0f}".replace(",", " ") if digits >= 100 else f"{digits:.2g}" if digits < 10 else f"{digits:.0f}"


def figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Cost a run and step against the number of runs: a panel a filter, a line an implementation."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator

    filters = list(dict.fromkeys(row["filter"] for row in rows))
    columns = min(4, len(filters))
    down = -(-len(filters) // columns)
    sheet = Figure(figsize=(max(5.0, 2.6 * columns), 0.9 + 2.3 * down), layout="constrained")
    axes = sheet.subplots(down, columns, squeeze=False, sharex=True).ravel()
    for ax in axes[len(filters) :]:
        ax.set_visible(False)
    for i, (name, ax) in enumerate(zip(filters, axes, strict=False)):
        for peer, look in LOOKS.items():
            own = [row for row in rows if row["filter"] == name and row["peer"] == peer]
            if own:
                line = {**line_style(look), "label": peer, "zorder": 3 if peer == OURS else 2}
                ax.plot([row["runs"] for row in own], [row["cpu_ns"] for row in own], **line)
        ax.set(xscale="log", yscale="log", title=TITLES[name])
        ax.yaxis.set_major_locator(LogLocator(numticks=10))
        if i % columns == 0:
            ax.set_ylabel("ns a run and step (CPU)")
        if i + columns >= len(filters):
            ax.set_xlabel("runs M")
            ax.tick_params(labelbottom=True)
    found = {text: handle for ax in axes for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    shown = [peer for peer in LOOKS if peer in found]
    sheet.legend([found[peer] for peer in shown], shown, loc="outside lower center", ncols=min(6, len(shown)))
    return sheet
