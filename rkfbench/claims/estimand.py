"""What a cell of a claim is about, before anything is known of it: statistics of metrics, and how they are combined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rkfbench.claims.expression import Expression
from rkfbench.times import is_time

Combination = Literal["value", "difference", "relative", "ratio", "slope", "smallest", "eigenvalue"]


@dataclass(frozen=True)
class Selected:
    """A filter that is chosen on the tuning runs: the candidate with the smallest statistic of the metric."""

    candidates: tuple[str, ...]
    metric: str
    statistic: str = "mean"


@dataclass(frozen=True)
class Point:
    """One statistic: metric, filter and case, each a name or arithmetic over names."""

    metric: Expression
    filter: Expression
    case: Expression

    @property
    def plain(self) -> bool:
        """Whether it is a single name in all three."""
        return all(part.name is not None for part in (self.metric, self.filter, self.case))


@dataclass(frozen=True)
class Estimand:
    """What a cell of a claim is about.

    combine: value: the only point; difference: a - b; relative: (a - b)/b; ratio: a/b; slope: sum of weight x point;
    smallest: share of runs in which the first point is the smallest; eigenvalue: the least one of the symmetric matrix
    whose lower triangle the points are, row by row. `ordered` marks comparisons that are decided run by run where runs
    are lost.
    """

    combine: Combination
    points: tuple[Point, ...]
    statistic: str = "mean"
    weights: tuple[float, ...] = ()
    ordered: bool = False
    margin: float = 0.0  # of an ordering, for the comparison of single runs
    lost: Literal["largest", "smallest"] = "largest"
    selected: tuple[tuple[str, Selected], ...] = ()

    @property
    def timing(self) -> bool:
        """Whether it is made of clock values."""
        return all(is_time(name) for point in self.points for name in point.metric.names())
