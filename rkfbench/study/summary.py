"""Statistics over the runs of a case: what summary.csv and series.csv say of one filter and one metric.

Means are over the runs that did not fail; quantiles count a failed run as +inf. A metric whose statistic is the root of
a mean (`pooled_rmse`) is shown as sqrt(mean) with its standard error by the delta method, se / (2 sqrt(mean)).
A sound run in which a metric is not defined (a share of no steps) is left out of that metric. What is not defined at
all (the spread of one run, the mean of none) is None, an empty cell.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rkfbench.store.blocks import Curve

Array = NDArray[Any]
Row = dict[str, Any]

QUANTILES = {"median": 0.5, "q05": 0.05, "q95": 0.95, "max": 1.0}


def summarise(values: Array, failed: Array, root: bool = False) -> Row:
    """mean, se, sd, median, q05, q95 and max of one metric; values and failed (M,)."""
    defined = failed | ~np.isnan(values)
    values, failed = values[defined], failed[defined]
    good = values[~failed]
    with np.errstate(over="ignore", invalid="ignore"):
        mean = float(good.mean()) if len(good) else None
        sd = float(good.std(ddof=1)) if len(good) > 1 else None
    ordered = np.sort(np.where(failed, np.inf, values))
    quantiles = {name: _quantile(ordered, q) if len(ordered) else None for name, q in QUANTILES.items()}
    if root:
        sd = _delta(mean, sd)
        mean = _root(mean)
        quantiles = {name: _root(value) for name, value in quantiles.items()}
    se = None if sd is None else sd / math.sqrt(len(good))
    return {"mean": mean, "se": se, "sd": sd, **quantiles}


def along(curve: Curve, root: bool = False) -> Iterable[Row]:
    """k, mean, se, median and the path of the first run of a curve, step after step."""
    for k, count, mean, m2, median, first in zip(*(each.tolist() for each in curve), strict=True):
        centre: float | None = mean if count else None
        se = math.sqrt(m2 / (count - 1) / count) if count > 1 else None
        middle: float | None = median if median == median else None
        if root:
            se, centre, middle, first = _delta(centre, se), _root(centre), _root(middle), math.sqrt(first)
        yield {"k": int(k), "mean": centre, "se": se, "median": middle, "first": first}


def _quantile(ordered: Array, q: float) -> float:
    """Linear interpolation between order statistics, where an infinite one makes the result infinite."""
    place = q * (len(ordered) - 1)
    low, high = float(ordered[math.floor(place)]), float(ordered[math.ceil(place)])
    weight = place - math.floor(place)
    return low if weight == 0 or low == high else low + weight * (high - low)


def _root(mean: float | None) -> float | None:
    return None if mean is None else math.sqrt(mean)


def _delta(mean: float | None, spread: float | None) -> float | None:
    """The spread of sqrt(mean) to first order; that of an exact zero is zero."""
    if mean is None or spread is None:
        return None
    return spread / (2 * math.sqrt(mean)) if mean else 0.0
