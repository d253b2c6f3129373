"""Catalogue entries of the metrics that tell how a filter behaves and what it shows of itself."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from annotated_types import Gt

from rkfbench.metrics.behaviour import (
    Distance,
    Error,
    Fluctuation,
    Nees,
    Settling,
    SquaredDifference,
    StandardDeviation,
    State,
)
from rkfbench.metrics.histories import Beyond, MeanOf

Parts = dict[str, Any]
Over = Annotated[Literal["mean", "median", "max"], "over the steps of a run"]
History = Annotated[str, "name of a history that the filter keeps, such as alpha, weight, nu"]
Component = Annotated[str, "one component of it, by the name of the measurement or state; default: all"]


def state() -> Parts:
    """Estimate of a state, averaged over the steps; `@k` is its curve."""
    return {"quantity": State()}


def error() -> Parts:
    """Error of a state with its sign, estimate minus truth, averaged over the steps; `@k` is its curve."""
    return {"quantity": Error()}


def fluctuation() -> Parts:
    """Root of the mean squared change of the error from step to step: RMS of e_k - e_{k-1}."""
    return {"quantity": Fluctuation(), "reduce": "root"}


def settling(limit: Annotated[float, Gt(0), "absolute error"] = 5.0) -> Parts:
    """Steps after the end of the scripted manoeuvre until the absolute error stays below a limit; infinite if it never
    does.
    """
    return {"quantity": Settling(limit=limit), "reduce": "last"}


def nees(over: Over = "mean") -> Parts:
    """Normalised squared error e' P^-1 e of the states named; its mean is their number if the filter is consistent."""
    return {"quantity": Nees(), "reduce": over}


def sd(over: Over = "mean") -> Parts:
    """Standard deviation that the filter states for its own error."""
    return {"quantity": StandardDeviation(), "reduce": over}


def rms_difference(to: Annotated[str, "label of the other filter"]) -> Parts:
    """Root of the mean squared difference from another filter's estimate, in the units of the state."""
    return {"quantity": SquaredDifference(to=to), "reduce": "root"}


def distance(to: Annotated[str, "label of the other filter"], over: Over = "median") -> Parts:
    """Distance from another filter's estimate, in standard deviations of this filter."""
    return {"quantity": Distance(to=to), "reduce": over}


def mean_of(
    name: History,
    component: Component = "",
    steps: Annotated[Literal["all", "outlier", "clean"], "which steps count, by the outlier flags"] = "all",
) -> Parts:
    """Mean over the steps of something that the filter shows."""
    return {"quantity": MeanOf(name=name, component=component, which=steps), "reduce": "mean_where"}


def share_below(
    name: History, limit: Annotated[float, "upper limit, itself excluded"] = 1.0, component: Component = ""
) -> Parts:
    """Share of the steps at which something that the filter shows lies below a limit, in any component."""
    return {"quantity": Beyond(name=name, component=component, limit=float(limit)), "reduce": "mean_where"}


def share_above(
    name: History, limit: Annotated[float, "lower limit, itself excluded"] = 1.0, component: Component = ""
) -> Parts:
    """Share of the steps at which something that the filter shows lies above a limit, in any component."""
    return {"quantity": Beyond(name=name, component=component, limit=float(limit), above=True), "reduce": "mean_where"}
