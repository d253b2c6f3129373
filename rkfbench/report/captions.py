"""Captions of figures: what is shown, over how many runs; and the note that runs failed or were lost."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import inf
from typing import Any

from rkfbench.report.material import distinct, is_root
from rkfbench.report.points import Drawn, Point
from rkfbench.report.words import PLAIN, Words
from rkfbench.scenario.display import metrics_in

NO_BREAK = "\u00a0"
ROOT = "root of the mean square"


def caption(figure: Drawn, points: Sequence[Point], words: Words = PLAIN) -> str:
    """What the figure shows, from its declaration and the points of one reading, in one paragraph."""
    ours = [point for point in points if point.role in ("ours", "level")]
    cases = [words.case(case).replace(" ", NO_BREAK) for case in distinct(point.case for point in ours) if case]
    metrics = distinct(point.metric for point in ours)
    parts = [figure.title, figure.caption, _what(figure, metrics, _runs(ours), points, words)]
    parts.append(_cases(cases) if cases else "")
    parts += [words.reading(each) for each in distinct(point.reading for point in ours)]
    parts.append(casualties(ours, words, [getattr(figure, "statistic", "")]))
    return " ".join(f"{part.rstrip('. ')}." for part in parts if part.strip())


def averaged(statistics: Sequence[str], metrics: Sequence[str], words: Words = PLAIN, name: bool = True) -> str:
    """What is made of the runs: `Mean of error norm`, `RMSE: root of the mean square`; or without the metrics' names.

    The mean of an RMSE over the runs is the root of the mean square, which is no mean of roots.
    """
    told = " and ".join(filter(None, (", ".join(statistics[:-1]), statistics[-1])))
    named = ", ".join(distinct(map(words.metric, metrics))) if name else ""
    roots = [each for each in metrics if "mean" in statistics and metrics_in(each) == (each,) and is_root(each)]
    if roots and len(roots) == len(metrics) and len(statistics) == 1:
        told = f"{named}: {ROOT}" if named else ROOT
    else:
        told += f" of {named}" if named else ""
        told += f" (mean of {', '.join(distinct(map(words.metric, roots)))}: {ROOT})" if roots else ""
    return told[:1].upper() + told[1:]


def casualties(points: Sequence[Any], words: Words = PLAIN, statistics: Collection[str] = ()) -> str:
    """Which filters failed or lost runs, with counts: a mean that leaves runs out must say so, and a median that does
    not, too.
    """
    counts: dict[str, list[tuple[int, int]]] = {}
    for label, failed, lost in distinct((point.filter, point.failed or 0, point.lost or 0) for point in points):
        counts.setdefault(label, []).append((failed, lost))
    told = []
    for label, pairs in counts.items():
        both = [_range(values, word) for values, word in zip(zip(*pairs, strict=True), ("failed", "lost"), strict=True)]
        if any(both):
            told.append(f"{words.filter(label)}: {' and '.join(each for each in both if each)}")
    counted = ["left out of means"] if set(statistics) != {"median"} else []
    counted += ["infinite in medians"] if "median" in statistics else []
    return f"Runs failed ({', '.join(counted)}) or lost. {'; '.join(told)}" if told else ""


def _what(figure: Any, metrics: Sequence[str], runs: str, points: Sequence[Point], words: Words) -> str:
    named = ", ".join(distinct(map(words.metric, metrics)))
    if figure.kind == "influence":
        return (
            f"Change of the estimate by one measurement of a scalar state, x⁺ − x⁻, against the innovation; P⁻ = "
            f"{figure.prior:g}, R = {figure.noise:g}"
        )
    if figure.kind == "runs":
        return f"{named}, one mark a run, the first {len(distinct(p.x for p in points))} of {runs}; line: their mean"
    if figure.statistic == "first":
        band = f"; shaded: ± {words.metric(figure.band)} over {runs}" if figure.band else ""
        return f"{named[:1].upper()}{named[1:]} of the first run{band}"
    statistic = f"{averaged([figure.statistic], metrics, words)} over {runs}"
    if figure.kind in ("curve", "panels"):
        statistic += " at each lag" if all(each.endswith("@lag") for each in metrics) else " at each step"
    errors = any(point.low is not None for point in points)
    mark = "band" if figure.kind in ("curve", "panels") else "bars" if figure.kind == "sweep" else "whiskers"
    width = "95 % interval between two of the runs" if figure.statistic == "median" else "± 2 standard errors"
    width += ", without a cap where it has no end" if any(point.high == inf for point in points) else ""
    parts = [statistic, f"{mark}: {width}" if errors else "no standard errors available"]
    if getattr(figure, "whiskers", None):
        parts.append("thin bars: ± one standard deviation of the runs")
    if getattr(figure, "band", None):
        parts.append(f"shaded: ± {words.metric(figure.band)}")
    if getattr(figure, "beside", None):
        parts.append(f"dotted: {words.metric(figure.beside)}")
    if any(point.role == "before" for point in points):
        parts.append(f"marks at the left: {', '.join(words.metric(each) for each in figure.befores)}")
    return "; ".join(parts)


def _runs(points: Sequence[Point]) -> str:
    counts = sorted({point.runs for point in points if point.runs is not None})
    return f"{counts[0] if len(counts) == 1 else f'{counts[0]} to {counts[-1]}'} runs" if counts else "the runs"


def _range(values: Sequence[int], word: str) -> str:
    low, high = min(values), max(values)
    return f"{high} {word}" if low == high and high else f"{low} to {high} {word}" if high else ""


def _cases(names: Sequence[str]) -> str:
    """The cases shown; a name that says itself that it is a case needs no word before it."""
    listed = "; ".join(names)
    if all(name.startswith("case") for name in names):
        return listed[:1].upper() + listed[1:]
    return f"{_plural('Case', names)} {listed}"


def _plural(word: str, items: Sequence[str]) -> str:
    return word if len(items) == 1 else f"{word}s"
