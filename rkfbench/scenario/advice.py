"""What to do about a metric that a table, figure or claim names and the scenario does not measure."""

from __future__ import annotations

import re
from collections.abc import Iterable

from rkfbench import metrics
from rkfbench.errors import SpecError, did_you_mean

_OPERATOR = re.compile(r"(?<=[\w)\]])([-+*/])(?=[\w(])")  # without the spaces that make it one


def not_measured(name: str, known: Iterable[str]) -> str:
    """The end of the message about such a name; `known` are the metrics that are measured."""
    near = did_you_mean(name, known)
    try:
        metrics.get(name)
    except SpecError:
        words = " ".join(_OPERATOR.split(name))
        return f": in arithmetic spaces stand around + - * /, as in '{words}'" if words != name else near
    return f"{near}: what is shown or judged must stand in `metrics`"
