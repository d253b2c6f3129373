"""The catalogue of metrics and how one is read from its name: `name(parameter=value)[states]@steps`."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Annotated, Any, Literal

from annotated_types import Ge, Interval

from rkfbench.catalogue import Catalogue, Entry, lookup
from rkfbench.catalogue import build as _build
from rkfbench.errors import SpecError
from rkfbench.metrics import entries
from rkfbench.metrics.base import RECORD, TRUTH, Metric, Trial
from rkfbench.metrics.conditioning import (
    Conclusion,
    ConditionRatioTopPsi,
    ConditionS,
    ConditionTopLambda,
    Premise,
    Which,
    WorseGivenPremise,
)
from rkfbench.metrics.errors import AbsoluteError, ErrorNorm, SquaredError, SquaredErrorWhere
from rkfbench.metrics.influence import About, InfluenceNorm, Xi
from rkfbench.metrics.objective import ArgminDistance, GradientRest
from rkfbench.metrics.weights import Lambda, LambdaAuc, OutlierRate

__all__ = ["METRICS", "Metric", "Trial", "applies", "get"]

Parts = dict[str, Any]


def err_norm() -> Parts:
    """Norm of the error, averaged over the steps: mean over k of |xhat_k - x_k|; `@k` is its curve."""
    return {"quantity": ErrorNorm()}


def max_error() -> Parts:
    """Largest absolute error over steps and states."""
    return {"quantity": AbsoluteError(), "reduce": "max"}


def mse() -> Parts:
    """Mean over the steps of the summed squared error; `mse[px]@900` is the squared error of one state at one step."""
    return {"quantity": SquaredError()}


def rmse(
    steps: Annotated[Literal["all", "outlier", "clean"], "which steps count, by the outlier flags"] = "all",
) -> Parts:
    """Root of the mean over the steps of the summed squared error, per run (eq. 41 of the PEKF paper); `rmse@k` is the
    curve of the root over runs (eq. 43).
    """
    if steps == "all":
        return {"quantity": SquaredError(), "reduce": "root"}
    return {"quantity": SquaredErrorWhere(steps), "reduce": "root_where"}


def pooled_rmse() -> Parts:
    """Root of the mean square error over steps and runs."""
    return {"quantity": SquaredError(), "root": True}


def tracking_rmse() -> Parts:
    """Root of the mean square error over the steps of the runs that are not lost."""
    return {"quantity": SquaredError(), "root": True, "tracking": True}


def cond_S() -> Parts:
    """Condition number of the innovation covariance S, averaged over the steps with all measurement components."""
    return {"quantity": ConditionS(), "reduce": "mean_where"}


def cond_S_max() -> Parts:
    """Largest condition number of the innovation covariance S over the steps with all measurement components."""
    return {"quantity": ConditionS(), "reduce": "max_where"}


def if_norm(
    every: Annotated[int, Ge(1), "steps between two evaluations"] = 10,
    about: Annotated[About, "the point c of (61): the true state, or the filter's own estimate"] = "truth",
    xi: Annotated[Xi, "the integrals of (71): expected, or read literally inside the sum"] = "expected",
) -> Parts:
    """Norm of the influence function, eqs (59)-(77) and (81) over all n states or those named, averaged over k = 10,
    20, ..., T where it exists.
    """
    return {"quantity": InfluenceNorm(every, about, xi), "reduce": "mean_where"}


def lambda_mean() -> Parts:
    """Mean over the steps with a measurement of lambda, the length of the whitened innovation."""
    return {"quantity": Lambda(), "reduce": "mean_where"}


WhichSteps = Annotated[
    Which,
    "which steps count; worse: cond(S) above that of `than` by more than rounding (1e-9); "
    "single: one residual above 10 thresholds, the others within theirs",
]


def share_46(steps: WhichSteps = "all", than: Annotated[str, "label of the filter compared with"] = "kf") -> Parts:
    """Share of the steps at which (46) holds: cond(Psi^(-1/2)) >= cond(R)."""
    return {"quantity": Premise(steps, than), "reduce": "mean_where"}


def share_47(steps: WhichSteps = "all", than: Annotated[str, "label of the filter compared with"] = "kf") -> Parts:
    """Share of the steps at which (47) holds: cond(R_h) >= cond(R), R_h the inflated R."""
    return {"quantity": Conclusion(steps, than), "reduce": "mean_where"}


def share_worse_given_46(than: Annotated[str, "label of the filter compared with"] = "kf") -> Parts:
    """Among the steps at which (46) holds, the share at which cond(S) exceeds that of another filter by more
    than rounding (1e-9).
    """
    return {"quantity": WorseGivenPremise(than), "reduce": "mean_where"}


def cond_ratio_top_psi(
    over: Annotated[str, "label of the filter compared with"] = "kf", count: Annotated[int, Ge(1), "steps a run"] = 25
) -> Parts:
    """Median ratio of cond(S) to that of another filter, at the steps of each run with the largest cond(Psi)."""
    return {"quantity": ConditionRatioTopPsi(over, count), "reduce": "median"}


def cond_S_top_lambda(
    by: Annotated[str, "label of the filter whose lambda counts"] = "aladkf",
    count: Annotated[int, Ge(1), "steps a run"] = 25,
) -> Parts:
    """Mean cond(S) at the steps of each run with the largest lambda."""
    return {"quantity": ConditionTopLambda(by, count)}


def gradient_rest() -> Parts:
    """What (24) neglects of the gradient of J_{k+1}, relative to the new term that it keeps; median over k = 5, 20,
    50.
    """
    return {"quantity": GradientRest(), "reduce": "median"}


def argmin_distance() -> Parts:
    """Distance of the estimate from the minimiser of J_k, (12), at k = 50."""
    return {"quantity": ArgminDistance()}


def lambda_auc() -> Parts:
    """Area under the ROC curve of lambda against the outlier flag."""
    return {"quantity": LambdaAuc()}


def outlier_rate(fifth: Annotated[int, Interval(ge=1, le=5), "1: the smallest lambda .. 5: the largest"]) -> Parts:
    """Share of outliers among the steps whose lambda lies in one fifth of those of the run."""
    return {"quantity": OutlierRate(fifth=fifth)}


METRICS: dict[str, Entry] = Catalogue(
    "metrics",
    {
        "err_norm": Entry(err_norm, paper="aladkf-2020", equations="(82)", needs=TRUTH),
        "max_error": Entry(max_error, needs=TRUTH),
        "mse": Entry(mse, needs=TRUTH),
        "rmse": Entry(rmse, paper="pekf-2017", equations="(41), (43)", needs=TRUTH),
        "pooled_rmse": Entry(pooled_rmse, needs=TRUTH),
        "tracking_rmse": Entry(tracking_rmse, needs=TRUTH),
        "cond_S": Entry(cond_S, paper="aladkf-2020", equations="(42)-(44)"),
        "cond_S_max": Entry(cond_S_max, paper="aladkf-2020", equations="(42)-(44)"),
        "if_norm": Entry(if_norm, paper="aladkf-2020", equations="(59)-(77), (81)", needs=TRUTH),
        "lambda_mean": Entry(lambda_mean, paper="aladkf-2020", equations="(38)"),
        "lambda_auc": Entry(lambda_auc, paper="aladkf-2020", equations="(38)", needs=RECORD),
        "outlier_rate": Entry(outlier_rate, paper="aladkf-2020", equations="(38)", needs=RECORD),
        "share_46": Entry(share_46, paper="aladkf-2020", equations="(46)"),
        "share_47": Entry(share_47, paper="aladkf-2020", equations="(47)"),
        "share_worse_given_46": Entry(share_worse_given_46, paper="aladkf-2020", equations="(46)-(47)"),
        "cond_ratio_top_psi": Entry(cond_ratio_top_psi, paper="aladkf-2020", equations="(42)-(43)"),
        "cond_S_top_lambda": Entry(cond_S_top_lambda, paper="aladkf-2020", equations="(43)-(44), (58)"),
        "gradient_rest": Entry(gradient_rest, paper="aladkf-2020", equations="(24)"),
        "argmin_distance": Entry(argmin_distance, paper="aladkf-2020", equations="(12), (36)"),
        **entries.METRICS,
    },
)

_NAME = re.compile(
    r"(?P<name>(?:[^()\[\]@:]+:)?\w+)(?:\((?P<params>[^()]*)\))?(?:\[(?P<states>[^\[\]]*)\])?(?:@(?P<at>k|lag|j(?:\+\d+)?|\d+(?:\.\.\d+)?))?"
)


@cache
def get(text: str) -> Metric:
    """The metric that a name describes; SpecError if there is none."""
    match = _NAME.fullmatch(text)
    if not match:
        raise SpecError(
            f"'{text}' is not a metric: write name, name[states], name@step, name@first..last or name@k for the curve "
            "(name@j, name@j+5, name@lag about a point)"
        )
    params = _params(match["params"] or "")
    parts = _build(METRICS, "metric", match["name"], params)
    states = tuple(part.strip() for part in match["states"].split(",")) if match["states"] else ()
    if getattr(parts["quantity"], "of_two", False) and len(states) != 2:
        raise SpecError(f"'{text}' needs two states, or one named twice: {match['name']}[x,y] or {match['name']}[x,x]")
    curve, at = match["at"] in ("k", "lag"), None
    if match["at"] == "lag" or (match["at"] or "").startswith("j"):
        parts = {**parts, "point": _point(match["at"])}
    elif match["at"] and not curve:
        first, _, last = match["at"].partition("..")
        at = (int(first), int(last or first))
    if match["at"] and getattr(parts["quantity"], "of_run", False):
        raise SpecError(f"'{text}' is about a run as a whole, not about single steps: write it without @{match['at']}")
    if curve and parts.get("reduce") in ("root", "root_where"):
        parts = {**parts, "root": True}  # the root is taken over the runs at each k
    needs = lookup(METRICS, "metric", match["name"]).needs | getattr(parts["quantity"], "needs", frozenset())
    return Metric(text, states=states, at=at, curve=curve, needs=needs, **parts)


def applies(metric: Metric, filt: Any) -> bool:
    """Whether a filter has what the metric needs; of a smoother of one point only what is about that point."""
    own: Callable[[Any], bool] | None = getattr(metric.quantity, "applies", None)
    smooths = getattr(filt, "target", None) is not None
    if smooths:
        fits = metric.point is not None and not (isinstance(metric.point, int) and metric.point > filt.lag)
    else:
        fits = metric.point in (None, "last")
    return fits and not lacking(metric, filt) and (own is None or own(filt))


def lacking(metric: Metric, filt: Any) -> frozenset[str]:
    """Histories that a metric needs and a filter does not keep."""
    return frozenset(metric.quantity.keep - getattr(filt, "sees", frozenset()) - {"cov"})


def _point(text: str) -> Literal["last", "lag"] | int:
    """What `lag`, `j` and `j+5` ask for."""
    if text == "lag":
        return "lag"
    return int(text[2:]) if text[1:] else "last"


def _params(text: str) -> Mapping[str, Any]:
    """`limit=2, over=kf` as a mapping; what reads as a number is one."""
    found: dict[str, Any] = {}
    for part in filter(None, (each.strip() for each in text.split(","))):
        key, equals, value = part.partition("=")
        if not equals:
            raise SpecError(f"'{part}' should be written parameter=value")
        found[key.strip()] = _plain(value.strip())
    return found


def _plain(value: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value
