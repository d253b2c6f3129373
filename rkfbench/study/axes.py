"""The settings of a filter among which the best one is looked for: parameters by dotted path, and their ranges."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rkfbench import filters
from rkfbench.catalogue import check
from rkfbench.errors import SpecError, UsageError
from rkfbench.parts import NOT_BUILD
from rkfbench.scenario.expand import MOST_POINTS, between
from rkfbench.scenario.filters import Head
from rkfbench.scenario.yaml import Mark, parse_value

WIDE = 20.0  # a range over more than this factor is divided geometrically, and drawn so
NOT_TUNED = ("label", "extra", "timing")  # they change no number

Setting = dict[str, Any]  # path of a parameter -> value


@dataclass(frozen=True)
class Axis:
    """One parameter and where its best value is looked for: the values of the grid, between which it may vary if it is
    `continuous`, on a logarithmic scale if it is `geometric`.
    """

    path: str
    values: tuple[Any, ...]
    continuous: bool = False
    geometric: bool = False

    def scaled(self, value: float) -> float:
        return math.log(value) if self.geometric else value

    def value(self, scaled: float) -> float:
        return math.exp(scaled) if self.geometric else scaled

    def gap(self, best: float) -> tuple[float, float]:
        """The grid points around the best one, scaled."""
        i = self.values.index(best)
        return self.scaled(self.values[max(i - 1, 0)]), self.scaled(self.values[min(i + 1, len(self.values) - 1)])


def axes_of(texts: Sequence[str], spec: Mapping[str, Any], points: int) -> list[Axis]:
    """The parameters of a filter that `--over` names; UsageError where one of them is named twice."""
    found = [axis(each, spec, points) for each in texts]
    for path, times in Counter(each.path for each in found).items():
        if times > 1:
            raise UsageError(f"--over {path}: given {times} times: write one range, or one list of values")
    return found


def axis(text: str, spec: Mapping[str, Any], points: int) -> Axis:
    """`threshold=0.5:3`, `threshold=0.5:3:9` or `root=symmetric,cholesky` for a filter's description.

    Raises UsageError for what cannot be read, and for values that the filter does not take.
    """
    path, equals, written = text.partition("=")
    mark = Mark(f"--over {text}")
    if not equals or not path or not written:
        raise UsageError(f"{mark.file}: should be written parameter=first:last or parameter=a,b,c")
    if path.partition(".")[0] in NOT_TUNED:
        raise UsageError(f"{mark.file}: '{path}' is not a parameter of the filter")
    ends = [parse_value(each, mark) for each in written.split(":")] if ":" in written else []
    if not ends:
        found = Axis(path, tuple(parse_value(each, mark) for each in written.split(",")))
    elif not _is_range(*ends):
        raise UsageError(
            f"{mark.file}: should be written parameter=first:last[:count] with first < last, both finite, "
            "and a whole number as count"
        )
    else:
        found = _range(path, float(ends[0]), float(ends[1]), ends[2] if len(ends) == 3 else points, spec)
    for value in found.values:
        try:
            _try(changed(spec, {path: value}))
        except SpecError as error:
            raise UsageError(f"{mark.file}: {error}") from None
    return found


def _is_range(first: Any, last: Any, count: Any = 2, *more: Any) -> bool:
    """Whether these are two ends with a distance, and perhaps a number of points."""
    if more or type(count) is not int or not all(type(each) in (int, float) for each in (first, last)):
        return False
    return bool(0 < last - first < math.inf)


def _range(path: str, low: float, high: float, points: int, spec: Mapping[str, Any]) -> Axis:
    """Points between two ends; whole numbers where the parameter is one."""
    if not 2 <= points <= MOST_POINTS:
        raise UsageError(f"--over {path}: between 2 and {MOST_POINTS} points are needed, not {points}")
    geometric = low > 0 and high > WIDE * low
    if geometric:
        values = [float(f"{value:.6g}") for value in np.geomspace(low, high, points)]
    else:
        values = [float(value) for value in between(low, high, points)]
    try:
        _try(changed(spec, {path: low + (high - low) / math.pi}))
    except SpecError:
        whole = dict.fromkeys(round(value) for value in values)
        return Axis(path, tuple(whole), geometric=geometric)
    return Axis(path, (low, *values[1:-1], high), continuous=True, geometric=geometric)


def changed(spec: Mapping[str, Any], setting: Setting) -> dict[str, Any]:
    """A filter's description with other values; UsageError where a path leads nowhere."""
    new: dict[str, Any] = dict(spec)
    for path, value in setting.items():
        *outer, last = path.split(".")
        node = new
        for key in outer:
            if not isinstance(node.get(key), Mapping):
                raise UsageError(f"the filter '{spec['label']}' has no '{path}'")
            node[key] = dict(node[key])
            node = node[key]
        node[last] = value
    return new


def current(spec: Mapping[str, Any], path: str) -> Any:
    """The value of a parameter in a filter's description; None where it has none."""
    node: Any = spec
    for key in path.split("."):
        node = node.get(key) if isinstance(node, Mapping) else None
    return node


def _try(spec: Mapping[str, Any]) -> None:
    """SpecError where a filter's description makes no sense."""
    check(Head, {key: value for key, value in spec.items() if key in NOT_BUILD})
    filters.build({key: value for key, value in spec.items() if key not in NOT_BUILD})
