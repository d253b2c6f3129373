"""The data behind a figure: from a declaration and the results to a flat list of points, which is also its CSV.

A figure is drawn from its points and its declaration alone, so the CSV beside a picture is all that the picture shows.
`low` and `high` are mean -+ 2 standard errors over the runs. The law of a median may be skewed, where many runs fail
beyond all bounds: there they are the 95 % interval between two of the runs. Empty where none can be given.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from rkfbench.report.material import Material, Row, distinct, key_of, number, printed_numbers, text
from rkfbench.scenario.display import Bars, Curve, Influence, Panels, Runs, Sweep
from rkfbench.store import files

Lines = Curve | Panels | Sweep | Runs | Bars
Drawn = Lines | Influence
METRIC = "influence"  # what stands as the metric of an influence curve


class Point(NamedTuple):
    """One plotted value.

    Roles: ours; beside, band and before (see `display`; the last has no x and the metric of its curve); level, a filter
    without the swept parameter; paper, a printed number.
    """

    role: str
    reading: str
    case: str
    filter: str
    metric: str
    x: float | str | None
    y: float
    low: float | None = None
    high: float | None = None
    sd: float | None = None
    runs: int | None = None
    failed: int | None = None
    lost: int | None = None


def points(figure: Lines, material: Material, reading: str) -> list[Point]:
    """Everything that `figure` shows under a reading; what the results do not hold is left out."""
    if isinstance(figure, Curve | Panels):
        return list(_steps(figure, material, reading))
    if isinstance(figure, Sweep):
        return list(_sweep(figure, material, reading))
    if isinstance(figure, Bars):
        return list(_bars(figure, material, reading))
    return list(_runs(figure, material, reading))


def needs_runs(figure: Lines) -> bool:
    """Whether the points come from numbers per run, which a committed folder does not keep."""
    return isinstance(figure, Runs) or (isinstance(figure, Sweep | Bars) and figure.statistic == "median")


def write_points(path: Path, found: Iterable[Point]) -> None:
    files.write_csv(path, Point._fields, found)


def read_points(path: Path) -> list[Point]:
    """What `write_points` wrote."""
    texts = ("role", "reading", "case", "filter", "metric")
    return [Point(**{**row, **{name: text(row[name]) for name in texts}}) for row in files.read_records(path)]


def _steps(figure: Curve | Panels, material: Material, reading: str) -> Iterator[Point]:
    roles = [("ours", metric) for metric in figure.metrics]
    roles += [(role, metric) for role, metric in (("beside", figure.beside), ("band", figure.band)) if metric]
    for case in material.pick_cases(figure, reading):
        for label in material.pick_filters(figure):
            counts = material.counts.get((reading, case, label), (None, None, None))
            for role, metric in roles:
                statistic = "mean" if role == "band" and figure.statistic == "first" else figure.statistic
                for row in material.series.get((reading, case, label, metric), ()):
                    y = number(row[statistic])
                    low, high = _interval(y, row["se"]) if statistic == "mean" and role != "band" else (None, None)
                    yield Point(role, reading, case, label, metric, row["k"], y, low, high, None, *counts)
            for metric, before in zip(figure.metrics, figure.befores, strict=False):
                summary = material.summary.get((reading, case, label, before))
                if summary is not None and (reading, case, label, metric) in material.series:
                    mark = _summary_point(figure.statistic, material, summary, "before", case, label, None)
                    yield mark._replace(metric=metric)


def _sweep(figure: Sweep, material: Material, reading: str) -> Iterator[Point]:
    swept = figure.over in material.sweep_columns
    family, _, parameter = figure.over.rpartition(".")
    chosen = material.pick_filters(figure)
    values = {} if swept else material.parameter_values(family, parameter)
    labels = distinct([*chosen, *values])
    for metric in figure.metrics:
        for label in labels:
            for case in material.pick_cases(figure, reading, extras=swept):
                row = material.summary.get((reading, case, label, metric))
                x = None if row is None else row.get(figure.over) if swept else values.get(label)
                if row is None or (swept and x is None):
                    continue
                rest = _without(case, figure.over) if swept else case
                role = "ours" if x is not None else "level"
                name = family if label in values else label
                yield _summary_point(figure.statistic, material, row, role, rest, name, x)


def _bars(figure: Bars, material: Material, reading: str) -> Iterator[Point]:
    table = material.printed.get(figure.paper) if figure.paper else None
    printed = printed_numbers(table) if table else {}
    for metric in figure.metrics:
        for case in material.pick_cases(figure, reading):
            for label in material.pick_filters(figure):
                row = material.summary.get((reading, case, label, metric))
                if row is not None:
                    yield _summary_point(figure.statistic, material, row, "ours", case, label, None)
                theirs = printed.get((label, case, metric, figure.statistic))
                if theirs is not None:
                    yield Point("paper", reading, case, label, metric, None, theirs)


def _runs(figure: Runs, material: Material, reading: str) -> Iterator[Point]:
    if not material.results.has_runs:
        return
    for metric in figure.metrics:
        for case in material.pick_cases(figure, reading):
            for label in material.pick_filters(figure):
                if (reading, case, label, metric) not in material.summary:
                    continue
                counts = material.counts.get((reading, case, label), (None, None, None))
                values = material.results.values(reading, case, label, metric)[: figure.first]
                for run, value in enumerate(values.tolist(), start=1):
                    yield Point("ours", reading, case, label, metric, run, value, None, None, None, *counts)


def _summary_point(
    statistic: str, material: Material, row: Row, role: str, case: str, label: str, x: float | str | None
) -> Point:
    key = reading, _, _, metric = key_of(row)
    y, se = material.estimate(key, statistic)
    low, high = _between(*material.rank_interval(key)) if statistic == "median" else _interval(y, se)
    if metric in ("failed", "lost") and low is not None and high is not None:  # shares
        low, high = max(low, 0.0), min(high, 1.0)
    counts = (row["runs"], row.get("failed"), row.get("lost"))
    return Point(role, reading, case, label, metric, x, y, low, high, row.get("sd"), *counts)


def _without(case: str, column: str) -> str:
    """The label of a case without the part that names the value of a sweep column."""
    return ",".join(part for part in case.split(",") if not part.startswith(f"{column}="))


def _interval(y: float, se: Any) -> tuple[float | None, float | None]:
    if se is None or not math.isfinite(se) or not math.isfinite(y):
        return None, None
    return y - 2 * se, y + 2 * se


def _between(low: float, high: float) -> tuple[float | None, float | None]:
    return (None, None) if math.isnan(low) else (low, high)
