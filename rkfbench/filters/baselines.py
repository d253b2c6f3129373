"""Two marks to measure nonlinear filters by: the estimate 0, and Bayes' rule on a grid for range and bearing. Both are
told what every filter is told.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known
from rkfbench.filters.recursion import prepare
from rkfbench.linalg import Array, exp
from rkfbench.models import Model
from rkfbench.models.range_bearing import RangeBearing
from rkfbench.streams import GROUP, Streams


@dataclass(frozen=True)
class Zero:
    """The estimate 0 at all times, with the covariance of the start."""

    sees = frozenset({"cov"})

    def check(self, model: Model) -> None:
        """It serves every model."""

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The estimates; a run with a measurement that is infinite has failed from there on, as for every filter."""
        y, x, P0, _, _ = prepare(model, y, x0, P0, Q, R)
        _only_cov(keep, "zero")
        failed = np.isinf(y).any(1).cumsum(0) > 0
        mean = np.broadcast_to(np.where(failed, np.nan, 0.0)[:, None], (len(y), *x.shape))
        cov = np.broadcast_to(P0, (len(y), *P0.shape)) if "cov" in keep else None
        return Estimate(mean, cov, failed[-1])


@dataclass(frozen=True)
class BayesGrid:
    """Posterior of a fixed point from ranges and bearings, with the range known to its mean rbar, on a grid of
    directions u.

    log w(u) = -(rbar u - x0)' P0^-1 (rbar u - x0)/2 - sum_i wrap(bearing_i - angle of u)^2/(2 R_22); the estimate is
    rbar E[u]. What is left of the range's spread, R_11/k, is neglected: millimetres in the PEKF paper.
    """

    points: int

    sees = frozenset({"cov"})

    def check(self, model: Model) -> None:
        """SpecError unless the model is range and bearing of a fixed point."""
        if not isinstance(getattr(model, "model", model), RangeBearing):
            raise SpecError("bayes serves the model range_bearing only")

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = ("cov",),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The posterior means, and covariances across the range; R must not change with time. The first range must not
        be missing.
        """
        self.check(model)
        y, x, P0, Q, R = prepare(model, y, x0, P0, Q, R)
        _only_cov(keep, "bayes")
        if R.shape != (2, 2, 1) or P0.shape[-1] > 1 or np.any(Q):
            raise SpecError("bayes needs no process noise, and one P0 and R for all steps and runs")
        mean, cov = np.empty((len(y), 2, y.shape[2])), np.empty((len(y), 2, 2, y.shape[2]))
        half = getattr(model, "angle", "").startswith("atan_")
        for first in range(0, y.shape[2], GROUP):  # what one group of runs needs fits into the cache
            runs = slice(first, first + GROUP)
            with np.errstate(all="ignore"):
                self._posterior(
                    y[..., runs], x[:, runs], P0[..., 0], R[1, 1, 0], mean[..., runs], cov[..., runs], half=half
                )
        return Estimate(mean, cov if "cov" in keep else None, np.isnan(mean[-1]).any(0))

    def _posterior(self, y: Array, x0: Array, P0: Array, variance: float, mean: Array, cov: Array, half: bool) -> None:
        """Fill in the posterior of some runs at all steps; half: a bearing (of atan) is known up to half a turn."""
        share = np.arange(self.points) / self.points  # of a full turn
        u = np.stack([np.cos(2 * np.pi * share), np.sin(2 * np.pi * share)])
        basis = np.stack([np.ones(self.points), *u, u[0] * u[0], u[0] * u[1], u[1] * u[1]])
        to_prior = np.linalg.solve(P0, u).T  # u' P0^-1
        square, linear = (to_prior * u.T).sum(1), to_prior @ x0
        misfit = np.zeros(linear.shape)
        ranges = np.nancumsum(y[:, 0], axis=0) / (~np.isnan(y[:, 0])).cumsum(0)
        for k, (rbar, bearing) in enumerate(zip(ranges, y[:, 1], strict=True)):
            turns = bearing * (1 / (2 * np.pi)) - share[:, None]
            turns -= 0.5 * np.rint(2 * turns) if half else np.rint(turns)  # wrapped, in turns
            turns[:, np.isnan(bearing)] = 0.0
            misfit += turns * turns
            weight = rbar * linear
            weight -= (0.5 * rbar * rbar) * square[:, None]
            weight -= misfit * (2 * np.pi**2 / variance)
            exp(np.subtract(weight, weight.max(0), out=weight))
            moments = basis @ weight
            centre_x, centre_y, xx, xy, yy = moments[1:] / moments[0]
            centre = np.stack([centre_x, centre_y])
            mean[k] = rbar * centre
            second = np.stack([np.stack([xx, xy]), np.stack([xy, yy])])
            cov[k] = rbar * rbar * (second - centre[:, None] * centre)


def _only_cov(keep: Collection[str], name: str) -> None:
    if set(keep) - {"cov"}:
        raise SpecError(f"{name} has no history but its covariance")
