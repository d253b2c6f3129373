"""From one document to its cells: readings x cases x sweep points, and the switches of the sensitivity study.

Order of precedence: file, reading, switch, case, sweep point. A cell is called by its case and point: `R2,rate=0.2`. A
swept path gives a column named by its last segment, or by as many as make it unique.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from itertools import product
from math import prod
from typing import Any

from rkfbench.errors import Path, SpecError
from rkfbench.scenario.override import graft
from rkfbench.scenario.schema import fault_of
from rkfbench.scenario.yaml import Map, Mark, Seq

NO_OVERRIDES = {"cases": "extra", "readings": "caveat"}  # what else may stand beside them
MOST_POINTS = 1000  # of one sweep
MOST_CELLS = 2_000
RESERVED = frozenset(
    {"reading", "case", "filter", "metric", "runs", "failed", "lost"}
    | {"k", "mean", "se", "sd", "median", "max", "first"}
)


@dataclass(frozen=True)
class Point:
    """One value of a sweep: what a label and a column show, and what takes the place of the node."""

    shown: Any
    value: Any
    at: Mark
    extra: bool = False


@dataclass(frozen=True)
class Draft:
    """A cell before its sections are checked: still with marks."""

    reading: str
    case: str
    point: Mapping[str, Any]
    switch: str | None
    extra: bool
    spec: Map


def drafts(document: Map, sections: Set[str], faults: list[tuple[SpecError, Path]]) -> Iterator[Draft]:
    """The cells of a document; `sections` are the keys of a cell. Overrides that fail go to `faults` with place."""
    base = document.only(sections)
    readings = _named(document, "readings", "default")
    cases = _named(document, "cases", "")
    sweeps = _sweeps(document, faults)
    switches = _named(document, "sensitivity")
    count = (len(readings) + len(switches)) * len(cases) * prod(map(len, sweeps.values()))
    if count > MOST_CELLS:
        faults.append((SpecError(f"readings, cases and sweeps make {count} cells, more than {MOST_CELLS}"), ("sweep",)))
        return

    def overridden(spec: Map, overrides: Map, *place: str) -> Map:
        for path, value in overrides.items():
            if path == NO_OVERRIDES.get(place[0]):
                continue
            try:
                if path.split(".")[0] not in sections:
                    raise SpecError("is not a part of an experiment that can be overridden")
                spec = graft(spec, path, value, overrides.values_at[path])
            except SpecError as error:
                faults.append((error, (*place, path)))
        return spec

    def crossed(spec: Map, reading: str, switch: str | None) -> Iterator[Draft]:
        for (case, overrides), points in product(cases.items(), product(*sweeps.values())):
            cell = overridden(spec, overrides, "cases", case)
            for path, point in zip(sweeps, points, strict=True):
                cell = overridden(cell, _single(path, point), "sweep")
            shown = {column: point.shown for column, point in zip(columns(list(sweeps)), points, strict=True)}
            label = ",".join([case] * bool(case) + [f"{column}={_text(value)}" for column, value in shown.items()])
            extra = overrides.get("extra") is True or any(point.extra for point in points)
            yield Draft(reading, label, shown, switch, extra, cell)

    for name, overrides in readings.items():
        yield from crossed(overridden(base, overrides, "readings", name), name, None)
    first, overrides = next(iter(readings.items()))
    for switch, changes in switches.items():
        spec = overridden(overridden(base, overrides, "readings", first), changes, "sensitivity", switch)
        yield from (draft for draft in crossed(spec, first, switch) if not draft.extra)


def _named(document: Map, section: str, default: str | None = None) -> dict[str, Map]:
    empty = Map(document.mark)
    named = document.get(section) or ({} if default is None else {default: empty})
    return {name: overrides if isinstance(overrides, Map) else empty for name, overrides in named.items()}


def _single(path: str, point: Point) -> Map:
    new = Map(point.at)
    new.put(path, point.value, point.at, point.at)
    return new


def _sweeps(document: Map, faults: list[tuple[SpecError, Path]]) -> dict[str, list[Point]]:
    """The points of every sweep: numbers in rising order, anything else as written."""
    sweeps = {}
    for path, written in (document.get("sweep") or {}).items():
        at = document["sweep"].values_at[path]
        try:
            tiers = isinstance(written, Map) and "values" in written
            points = _points(written["values"] if tiers else written, at, extra=False)
            seen = {_text(point.shown) for point in points}
            more = _points(written["extra"], at, extra=True) if tiers and written.get("extra") else []
            points += [point for point in more if _text(point.shown) not in seen]
            twice = [text for text, times in Counter(_text(point.shown) for point in points).items() if times > 1]
            if twice:
                raise SpecError(f"lists {twice[0]} twice")
            if faulty := next(filter(None, (_fault_of(_text(point.shown)) for point in points)), ""):
                raise SpecError(faulty)
            if all(type(point.shown) in (int, float) for point in points):
                points.sort(key=lambda point: float(point.shown))
            sweeps[path] = points
        except SpecError as error:
            faults.append((error, ("sweep", path)))
    return sweeps


def _fault_of(text: str) -> str:
    """What is wrong with the text of a point, which becomes a part of the name of a case."""
    if "," in text:
        return f"'{text}' holds a comma, which parts the name of a case: give the value a label without one"
    return fault_of(text)


def _points(written: Any, at: Mark, extra: bool) -> list[Point]:
    if isinstance(written, Seq):
        values = list(zip(written, written.values_at, strict=True))
        return [Point(value, value, place, extra) for value, place in values]
    if "step" in written:
        return [Point(value, value, at, extra) for value in spaced(written["from"], written["to"], written["step"])]
    return [Point(label, value, written.values_at[label], extra) for label, value in written.items()]


def spaced(first: float, last: float, step: float) -> list[float]:
    """first, first + step, ... up to last."""
    steps = (last - first) / step
    if not 0 <= steps < MOST_POINTS:
        raise SpecError(f"makes no sensible range: between 1 and {MOST_POINTS} values are expected")
    return [_rounded(first + i * step) for i in range(int(steps + 1e-9) + 1)]


def between(first: float, last: float, count: int) -> list[float]:
    """`count` equally spaced values with both ends."""
    if not 2 <= count <= MOST_POINTS:
        raise SpecError(f"between 2 and {MOST_POINTS} values are expected, not {count}")
    return [_rounded(first + i * (last - first) / (count - 1)) for i in range(count)]


def _rounded(value: float) -> float:
    """The value without the dust of binary fractions; a whole number as an int, so that it shows as `1`."""
    value = float(f"{value:.12g}")
    return int(value) if value.is_integer() and abs(value) < 1e15 else value


def columns(paths: list[str]) -> list[str]:
    """For each path the shortest tail that no other path has and no column of the results is called."""
    names = []
    for path in paths:
        parts = path.split(".")
        tails = [".".join(parts[-count:]) for count in range(1, len(parts) + 1)]
        others = [f".{other}" for other in paths if other != path]
        free = (tail for tail in tails if tail not in RESERVED and not any(o.endswith(f".{tail}") for o in others))
        names.append(next(free, path))
    return names


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
