"""What a reader sees in the place of labels: of cases, metrics, filters and readings.

The scenario's own `names` come first.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from rkfbench.report.style import display_name
from rkfbench.scenario.display import metrics_in

METRICS = {
    "err_norm": "error norm", "max_error": "largest error", "mse": "MSE", "rmse": "RMSE", "pooled_rmse": "pooled RMSE",
    "axis_rmse": "RMSE an axis", "radial_rmse": "radial RMSE", "tangential_rmse": "tangential RMSE",
    "stated_rmse": "RMSE stated by P", "sd": "stated standard deviation", "excess": "stated minus actual square",
    "indefinite": "share of updates with indefinite P", "crossed": "share of runs that cross the cut of the bearing",
    "cond_S": "cond(S)", "cond_S_max": "largest cond(S)", "if_norm": "norm of the influence function",
    "lambda_mean": "mean lambda", "share_46": "share of steps with (46)", "lost": "share of lost runs",
    "failed": "share of failed runs", "nees": "NEES", "nis": "NIS",
    "nis_beyond": "share of NIS beyond chi-square", "fluctuation": "RMS of the step-to-step change of the error",
    "settling": "steps until the error settles", "tracking_mse": "MSE of tracking runs",
    "tracking_rmse": "RMSE of tracking runs",
    "mse_prior": "MSE of the prior",
    "influence": "x⁺ − x⁻", "improvement": "improvement (%)",
    "time_ms": "time of one run (ms)", "time_ns": "time of a run and step in a batch (ns)",
}  # fmt: skip
_METRIC = re.compile(r"(?P<base>\w+)(?:\((?P<params>[^()]*)\))?(?:\[(?P<states>[^\[\]]*)\])?(?:@(?P<step>.*))?")
_PLACE = re.compile(r"^[^()\[\]]*:")  # the file or module of an own metric


@dataclass(frozen=True)
class Words:
    """Names for readers; `given` maps labels of cases, sweep columns and their points, filters and metrics.

    caveats: reading -> what must be said wherever it is shown.
    """

    given: Mapping[str, str] = field(default_factory=dict)
    caveats: Mapping[str, str] = field(default_factory=dict)

    def case(self, label: str) -> str:
        """`R2,rate=0.2` -> `R2, rate = 0.2`, with the names that are given for the whole or its parts."""
        return self.given.get(label) or ", ".join(self._part(part) for part in label.split(","))

    def column(self, name: str) -> str:
        """A swept parameter, by its column or its dotted path."""
        return self.given.get(name) or self.given.get(tail := name.rpartition(".")[2], tail)

    def filter(self, label: str) -> str:
        """`fpmcs[sigma=1]` -> `FP-MCS, sigma = 1`."""
        return self.given.get(label) or display_name(label)

    def metric(self, name: str) -> str:
        """`mse[px]@900` -> `MSE [px] at k = 900`; that of a curve (`err_norm@k`) is the name alone; within arithmetic
        over metrics each.
        """
        if name not in self.given and (parts := metrics_in(name)) != (name,):
            longest_first = sorted(parts, key=len, reverse=True)
            return re.sub("|".join(map(re.escape, longest_first)), lambda match: self.metric(match[0]), name)
        bare, _, step = name.partition("@")
        return self.given.get(name) or (self.given.get(bare) or _quantity(bare)) + _at(step)

    def reading(self, name: str) -> str:
        """A reading, or a switch that starts from it, with its caveat: two sentences, either of which may be empty."""
        called = f"Reading {name}." if name not in ("", "default") else ""
        return " ".join(filter(None, (called, self.caveats.get(name.partition("+")[0], ""))))

    def _part(self, part: str) -> str:
        column, equals, value = part.partition("=")
        return self.given.get(part) or (f"{self.column(column)} = {value}" if equals else part)


PLAIN = Words()


def _quantity(name: str) -> str:
    """A metric without its step: `share_below(name=beta)` -> `share of steps with beta < 1`.

    One of the user's is called as it is there, without its file or module: `mine.py:worst[angle]` -> `worst[angle]`.
    """
    match = _METRIC.fullmatch(name)
    if not match:
        return _PLACE.sub("", name)
    base, states = match["base"], f" [{match['states'].replace(',', ', ')}]" if match["states"] else ""
    pairs = (each.partition("=") for each in (match["params"] or "").split(",") if each)
    params = {key.strip(): value.strip() for key, _, value in pairs}
    shown = METRICS.get(base, base.replace("_", " "))
    if "name" in params:
        of = params.pop("name").replace("_", " ") + (f" of {params.pop('component')}" if "component" in params else "")
        if base in ("share_below", "share_above"):
            shown = f"share of steps with {of} {'<' if base == 'share_below' else '>'} {params.pop('limit', '1')}"
        else:
            shown = f"mean {of}" if base == "mean_of" else f"{shown} {of}"
    if params.get("steps") in ("outlier", "clean"):
        shown += " at outliers" if params.pop("steps") == "outlier" else " at clean steps"
    if "over" in params:
        shown = f"{params.pop('over')} {shown}"
    rest = f" ({', '.join(f'{key} = {value}' for key, value in params.items())})" if params else ""
    return shown + rest + states


def _at(step: str) -> str:
    if step in ("", "k", "lag", "j"):
        return ""
    if step.startswith("j+"):
        return f" at lag {step[2:]}"
    return f" at k = {step.replace('..', ' to ')}"
