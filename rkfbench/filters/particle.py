"""Bootstrap particle filter, and the smoother of one point that carries a copy of x_j along with each particle. All
details are ours.

Particles (n, M, N) move with the model and the law of the process noise; log weights add the log likelihood; where the
effective sample size 1/sum W^2 falls below a share of N, systematic resampling. Portions of 25 runs of a group of 128
(its last one: 3) go through one after the other, each with streams of its own, so memory grows neither with the steps
nor with the runs. How many runs there are changes no number of a whole portion, and a study computes whole ones only;
a last portion that is cut short has other draws. A run whose weights all vanish has failed; its neighbours are not
touched.

Pitfall: a resampled copy of x_j can only die out. The number of distinct copies is part of the result (`distinct`).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Interval
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known, Setting
from rkfbench.filters.cloud import Cloud
from rkfbench.filters.recursion import History, prepare
from rkfbench.filters.smoothing import SEES, At, Lag, Start, ends, point
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.noise import Gaussian, Law
from rkfbench.noise.matrices import factor
from rkfbench.streams import GROUP, Onward, Streams

TOGETHER = 25  # runs that go through together: their particles stay in the cache

Particles = Annotated[int, Ge(2), "number of particles"]
Likelihood = Annotated[
    Literal["law", "gauss"], "density of the measurement noise: the true law without shots, or N(0, R)"
]
Ess = Annotated[
    float, Interval(ge=0, le=1), "resample where the effective sample size is below this share of the particles"
]


@dataclass(frozen=True)
class ParticleFilter:
    """Bootstrap particle filter; without a law of the noise it takes N(0, Q) and N(0, R)."""

    particles: int = 500
    likelihood: Likelihood = "law"
    ess: float = 0.5
    process: Law | None = None
    measurement: Law | None = None
    only: int | None = None  # how many runs of a batch are wanted; the others are left out, as if they had failed

    def first(self, runs: int) -> ParticleFilter:
        """The filter for the first runs of a batch: no run depends on those beside it."""
        return replace(self, only=runs)

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return frozenset({"cov", "prior_mean", "prior_cov", "ess"})

    def placed(self, setting: Setting) -> ParticleFilter:
        """The filter with the laws of an experiment."""
        told = replace(
            self, process=self.process or setting.process, measurement=self.measurement or setting.measurement
        )
        if self.likelihood == "law":
            check_density(told.measurement)
        return told

    def fixed_point(self, at: int | None, lag: int | None, start: Start = "j") -> ParticleSmoother:
        """The smoother of one point with these particles."""
        if start != "j":
            raise SpecError("particles always use y_j", ["start"])
        return ParticleSmoother(self, at, lag)

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
        """The weighted means; see `rkfbench.filters.base.Filter`.

        More runs than the streams have are those of several cases, one case after the other: all cases meet the same
        draws, as they would one by one. Raises SpecError when they are not as many.
        """
        estimates = []
        for cloud, yg in self.clouds(model, y, x0, P0, Q, R, streams):
            history = History(keep, len(yg))
            with np.errstate(all="ignore"):
                for k, yk in enumerate(yg, 1):
                    cloud.predict(k)
                    prior = cloud.moments({"prior_mean", "prior_cov"} & {*keep}, "prior_")
                    cloud.weigh(yk, k)
                    history.add(ess=cloud.size[None], **prior, **cloud.moments({"mean", "cov"} & {"mean", *keep}))
                    cloud.resample()
            estimates.append(history.estimate(failed=cloud.dead))
        return _joined(estimates, np.atleast_3d(y).shape[2], streams)

    def clouds(
        self, model: Model, y: Array, x0: Array, P0: Array, Q: Array, R: Array, streams: Streams | None
    ) -> Iterator[tuple[Cloud, Array]]:
        """The particles at k = 0 and the measurements of one group of runs after the other."""
        y, x0, P0, Q, R = prepare(model, y, x0, P0, Q, R)
        if {Q.shape[2:], R.shape[2:], P0.shape[2:]} != {(1,)}:
            raise SpecError("a particle filter takes one P0, Q and R for all runs and steps")
        M = y.shape[2]
        streams = (streams or Streams(0, groups=-(-M // GROUP))).within("particles")
        process = self.process or Gaussian.of(Q[..., 0])
        measurement = self.measurement if self.measurement and self.likelihood == "law" else Gaussian.of(R[..., 0])
        of_a_case = _of_a_case(M, streams)
        wanted = of_a_case if self.only is None else min(of_a_case, self.only)
        for start in (first + i for first in range(0, wanted, GROUP) for i in range(0, GROUP, TOGETHER)):
            if start >= wanted:
                break
            end = min(start + TOGETHER, start - start % GROUP + GROUP, of_a_case)
            runs = np.concatenate([np.arange(start, end) + case for case in range(0, M, of_a_case)])
            scope, group = f"{streams.scope}{start % GROUP}/", streams.first + start // GROUP
            draw = Onward(streams.seed, group, 1, scope, (end - start) * self.particles)
            yield (
                Cloud(model, process, measurement, draw, x0[:, runs], factor(P0[..., 0]), self.particles, self.ess),
                y[..., runs],
            )


@dataclass(frozen=True)
class ParticleSmoother:
    """Augmented-state particle smoother: the particles' own x_j, weighted by all measurements up to j + t, t = 0 ..
    lag.
    """

    filter: ParticleFilter
    at: int | None = None
    lag: int | None = None

    def first(self, runs: int) -> ParticleSmoother:
        """The smoother for the first runs of a batch."""
        return replace(self, filter=self.filter.first(runs))

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep; `distinct` is the number of distinct copies of x_j."""
        return SEES | {"distinct"}

    @property
    def target(self) -> int | None:
        """The step j."""
        return self.at

    def passes(self, steps: int) -> ParticleFilter | None:
        """The filter whose estimates come along (`passed` of the estimate), if the smoother runs through all steps."""
        return self.filter if self.at is not None and self.lag is not None and self.at + self.lag == steps else None

    def placed(self, setting: Setting) -> ParticleSmoother:
        """The smoother at the point of an experiment, with its laws."""
        at, lag = point(self.at, self.lag, setting)
        return replace(self, filter=self.filter.placed(setting), at=at, lag=lag)

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
        """The estimates of x_j: mean (lag + 1, n, M); see `rkfbench.filters.base.Filter`."""
        at, lag = ends(self.at, self.lag, len(y))
        covs = bool({"cov", "prior_cov", "post_cov"} & {*keep})
        estimates = []
        for cloud, yg in self.filter.clouds(model, y, x0, P0, Q, R, streams):
            history, own, passed = (
                History({*keep} & {"cov", "distinct"}, lag + 1),
                {},
                History({"prior_mean"}, at + lag),
            )
            with np.errstate(all="ignore"):
                for k, yk in enumerate(yg[: at + lag], 1):
                    cloud.predict(k)
                    if k == at:
                        own = cloud.moments({"prior_mean"} | ({"prior_cov"} if covs else set()), "prior_")
                        cloud.remember()
                    prior = cloud.moments({"prior_mean"}, "prior_") if "passed" in keep else {}
                    cloud.weigh(yk, k)
                    if "passed" in keep:
                        passed.add(**prior, **cloud.moments({"mean"}))
                    if k >= at:
                        seen = cloud.moments({"mean"} | ({"cov"} if covs else set()), of=cloud.copy)
                        own = own | {f"post_{name}": value for name, value in seen.items()} if k == at else own
                        history.add(distinct=cloud.distinct[None], **seen)
                    cloud.resample()
            estimate = history.estimate(failed=cloud.dead)
            extras = {name: value[None] for name, value in own.items()}
            on_the_way = passed.estimate(cloud.dead) if "passed" in keep else None
            estimates.append(replace(estimate, target=at, extras={**estimate.extras, **extras}, passed=on_the_way))
        return _joined(estimates, np.atleast_3d(y).shape[2], streams)


def pf(particles: Particles = 500, likelihood: Likelihood = "law", ess: Ess = 0.5) -> ParticleFilter:
    """Bootstrap particle filter: x_i <- f(x_i) + w_i, weights by the likelihood of y, systematic resampling; the
    weighted mean.
    """
    return ParticleFilter(particles, likelihood, ess)


def ps(
    particles: Particles = 500, likelihood: Likelihood = "law", ess: Ess = 0.5, at: At = None, lag: Lag = None
) -> ParticleSmoother:
    """Augmented-state particle smoother: the weighted mean of the copies of x_j that the particles carry along."""
    return ParticleSmoother(pf(particles, likelihood, ess), at, lag)


def check_density(law: Law | None) -> None:
    """SpecError unless the law has a density that can weigh particles."""
    if law is None:
        return
    try:
        with np.errstate(all="ignore"):
            density = law.logpdf(np.ones((law.dim, 1)))
    except np.linalg.LinAlgError:
        density = np.array([np.nan])
    if not np.isfinite(density).all():
        raise SpecError(
            "the measurement noise has no density that could weigh particles (a variance of 0?)", ["likelihood"]
        )


def _of_a_case(M: int, streams: Streams | None) -> int:
    """How many of M runs are those of one case: as many as there are streams for."""
    runs = M if streams is None else min(M, streams.runs)
    if M % runs:
        raise SpecError(f"{M} runs are not those of several cases: there are streams for {runs}")
    return runs


def _joined(estimates: Sequence[Estimate], M: int, streams: Streams | None) -> Estimate:
    """The estimates of all groups, side by side; runs that nobody wants are NaN and failed."""
    first, runs = estimates[0], _of_a_case(M, streams)

    def beside(arrays: Sequence[NDArray[Any]], fill: float | bool = np.nan) -> NDArray[Any]:
        """Arrays (..., some runs of every case) as one (..., M), case after case."""
        of_cases = [A.reshape(*A.shape[:-1], M // runs, -1) for A in arrays]
        left = runs - sum(A.shape[-1] for A in of_cases)
        rest = np.full((*of_cases[0].shape[:-1], left), fill)
        return np.concatenate([*of_cases, rest], axis=-1).reshape(*arrays[0].shape[:-1], M)

    passed = [each.passed for each in estimates if each.passed is not None]
    return Estimate(
        beside([each.mean for each in estimates]),
        None if first.cov is None else beside([each.cov for each in estimates if each.cov is not None]),
        beside([each.failed for each in estimates], fill=True),
        {name: beside([each.extras[name] for each in estimates]) for name in first.extras},
        first.target,
        _joined(passed, M, streams) if passed else None,
    )
