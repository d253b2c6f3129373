"""Words for figures and tables: names of cases and metrics, and captions that say what is shown over how many runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

from rkfbench.own import short
from rkfbench.report.material import distinct
from rkfbench.report.points import Lines, Point
from rkfbench.report.style import display_name

METRICS = {
    "err_norm": "error norm", "max_error": "largest error", "mse": "MSE", "rmse": "RMSE", "pooled_rmse": "pooled RMSE",
    "cond_S": "cond(S)", "cond_S_max": "largest cond(S)", "if_norm": "norm of the influence function",
    "lambda_mean": "mean lambda", "share_46": "share of steps with (46)", "lost": "share of lost runs",
    "failed": "share of failed runs", "nees": "NEES",
    "time_ms": "time of one run", "time_ns": "time of a run and step in a batch",
}  # fmt: skip
NO_BREAK = "\u00a0"


def caption(figure: Lines, points: Sequence[Point]) -> str:
    """What the figure shows, from its declaration and the points of one reading, in one paragraph."""
    ours = [point for point in points if point.role in ("ours", "level")]
    cases = [case_name(case).replace(" ", NO_BREAK) for case in distinct(point.case for point in ours) if case]
    reading = distinct(point.reading for point in ours)
    metrics = ", ".join(distinct(metric_name(point.metric) for point in ours))
    parts = [figure.title, figure.caption, _what(figure, metrics, _runs(ours), points)]
    parts.append(f"{_plural('Case', cases)} {'; '.join(cases)}" if cases else "")
    parts.append(f"Reading {', '.join(reading)}" if any(reading) else "")
    parts.append(casualties(ours))
    return " ".join(f"{part.rstrip('. ')}." for part in parts if part.strip())


def casualties(points: Sequence[Any]) -> str:
    """Which filters failed or lost runs, with counts: a mean that leaves runs out must say so."""
    counts: dict[str, list[tuple[int, int]]] = {}
    for label, failed, lost in distinct((point.filter, point.failed or 0, point.lost or 0) for point in points):
        counts.setdefault(label, []).append((failed, lost))
    told = []
    for label, pairs in counts.items():
        words = [
            _range(values, word) for values, word in zip(zip(*pairs, strict=True), ("failed", "lost"), strict=True)
        ]
        if any(words):
            told.append(f"{display_name(label)} {' and '.join(word for word in words if word)}")
    return f"Runs failed (left out of means) or lost: {', '.join(told)}" if told else ""


def case_name(case: str) -> str:
    """`R2,rate=0.2` -> `R2, rate = 0.2`."""
    return case.replace("=", " = ").replace(",", ", ")


def metric_name(metric: str) -> str:
    """`mse[px]@900` -> `MSE [px] at k = 900`; that of a curve (`err_norm@k`) is the name alone."""
    name, _, step = metric.partition("@")
    base = re.split(r"[(\[]", name, maxsplit=1)[0]
    shown = METRICS.get(base, short(base).replace("_", " "))
    rest = name[len(base) :].replace("(", " (").replace("[", " [").replace(",", ", ").replace("=", " = ")
    if step.startswith("j+"):
        return f"{shown}{rest} at lag {step[2:]}"
    return f"{shown}{rest}" + (f" at k = {step.replace('..', ' to ')}" if step not in ("", "k", "lag") else "")


def _what(figure: Any, metrics: str, runs: str, points: Sequence[Point]) -> str:
    if figure.kind == "runs":
        return f"{metrics}, one mark a run, the first {len(distinct(p.x for p in points))} of {runs}; line: their mean"
    if figure.statistic == "first":
        band = f"; shaded: ± {metric_name(figure.band)} over {runs}" if figure.band else ""
        return f"{metrics} of the first run{band}"
    statistic = f"{figure.statistic.capitalize()} of {metrics} over {runs}"
    if figure.kind in ("curve", "panels"):
        statistic += " at each step"
    errors = any(point.low is not None for point in points)
    mark = "band" if figure.kind in ("curve", "panels") else "bars" if figure.kind == "sweep" else "whiskers"
    parts = [statistic, f"{mark}: ± 2 standard errors" if errors else "no standard errors available"]
    if getattr(figure, "whiskers", None):
        parts.append("thin bars: ± one standard deviation of the runs")
    if getattr(figure, "band", None):
        parts.append(f"shaded: ± {metric_name(figure.band)}")
    if getattr(figure, "beside", None):
        parts.append(f"dotted: {metric_name(figure.beside)}")
    return "; ".join(parts)


def _runs(points: Sequence[Point]) -> str:
    counts = sorted({point.runs for point in points if point.runs is not None})
    return f"{counts[0] if len(counts) == 1 else f'{counts[0]} to {counts[-1]}'} runs" if counts else "the runs"


def _range(values: Sequence[int], word: str) -> str:
    low, high = min(values), max(values)
    return f"{high} {word}" if low == high and high else f"{low} to {high} {word}" if high else ""


def _plural(word: str, items: Sequence[str]) -> str:
    return word if len(items) == 1 else f"{word}s"
