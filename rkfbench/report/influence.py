"""Influence curves: what one update of a filter makes of an innovation, for a scalar state with y = x + v.

    x+ - x- as a function of nu = y - x-, from P- and R

A filter is asked as it is, whatever it consists of, so weights, iterations and regressions are seen alike; all
innovations go through it at once as the runs of one batch. For the Kalman filter it is the line P-/(P- + R) nu.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from rkfbench.errors import SpecError, UsageError
from rkfbench.linalg import Array
from rkfbench.models.base import Linear
from rkfbench.report.points import METRIC, Point
from rkfbench.scenario.display import Influence

INNOVATIONS = 401  # of one curve


@dataclass(frozen=True)
class Scalar(Linear):
    """A state that stays where it is, and is measured itself."""

    states: ClassVar[tuple[str, ...]] = ("x",)
    measurements: ClassVar[tuple[str, ...]] = ("y",)

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array | None]:  # type: ignore[override]
        return np.eye(1), np.eye(1), None


def curve(filt: Any, nu: Array, prior: float, noise: float) -> Array:
    """x+ - x- for each innovation nu (M,)."""
    P, R = np.array([[prior]]), np.array([[noise]])
    return np.asarray(filt.run(Scalar(), nu[None, None], np.zeros(1), P, Q=np.zeros((1, 1)), R=R).mean[0, 0])


def influence_points(figure: Influence, filters: Sequence[Mapping[str, Any]], reading: str) -> Iterator[Point]:
    """The curves of the filters that `figure` names, as described in a scenario.

    Raises UsageError where a filter needs more than a scalar measurement.
    """
    from rkfbench.filters import build
    from rkfbench.scenario.filters import description

    described = {each["label"]: each for each in filters}
    nu = np.linspace(-figure.largest, figure.largest, INNOVATIONS)
    for label in figure.filters:
        if label not in described:
            continue
        try:
            shift = curve(build(description(described[label])), nu, figure.prior, figure.noise)
        except (SpecError, ValueError, IndexError, TypeError, AttributeError) as error:
            raise UsageError(f"figure {figure.id}: {label} has no update of a scalar state alone: {error}") from error
        for x, y in zip(nu.tolist(), shift.tolist(), strict=True):
            yield Point("ours", reading, "", label, METRIC, x, y)
