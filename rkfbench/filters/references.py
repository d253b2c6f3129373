"""References: filters that know more than a filter may. They are drawn beside the others and never ranked."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters import recursion
from rkfbench.filters.base import Estimate, Known
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.moments import Linear
from rkfbench.linalg import Array, mul
from rkfbench.models import Model
from rkfbench.streams import Streams


@dataclass(frozen=True)
class Clairvoyant:
    """Kalman filter with the mean and covariance that each noise value really had, given its coin, label, scale and
    time.

    Given that record the noise is Gaussian with known moments, so this is the conditional mean: on a linear model no
    filter has a smaller mean
    square error, and the error is a true lower bound. Known means of the process noise are followed apart, d_k = F
    d_{k-1} + E w_k.
    """

    kf: GaussianFilter = field(default_factory=lambda: GaussianFilter(moments=Linear()))

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return self.kf.sees

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear: only then is the bound exact."""
        self.kf.check(model)

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
        """The estimates; Q and R as told to the other filters are not used."""
        return recursion.collect(self.steps(model, y, x0, P0, Q=Q, R=R, known=known), keep, len(y))

    def steps(
        self, model: Model, y: Array, x0: Array, P0: Array, *, Q: Array, R: Array, known: Known | None
    ) -> Iterator[recursion.Step]:
        """The steps, one after the other."""
        if known is None:
            raise SpecError("clairvoyant_kf needs the record of the noise, which recorded data does not have")
        moved = _moved(model, known.w.mean, len(y))
        y = (
            y
            - known.v.mean
            - (0.0 if moved is None else np.stack([mul(model.H(d, k), d) for k, d in enumerate(moved, 1)]))
        )
        told = recursion.prepare(model, y, x0, P0, known.w.cov(), known.v.cov(), recorded=True)
        steps = self.kf.prepared(model, *told)
        if moved is None:
            return steps
        return (step._replace(prior_x=step.prior_x + d, x=step.x + d) for step, d in zip(steps, moved, strict=True))


def _moved(model: Model, mean: Array | float, T: int) -> Array | None:
    """What known means of the process noise (T, n, M) do to the states; None where there are none."""
    if not np.any(mean):
        return None
    means = np.broadcast_to(mean, (T, *np.shape(mean)[1:]))
    moved = np.zeros((T, len(model.states), means.shape[-1]))
    d = moved[0]
    for k, each in enumerate(means, 1):
        d = moved[k - 1] = mul(model.F(d, k), d) + each
    return moved


@dataclass(frozen=True)
class Rejecting:
    """Kalman filter that is told which measurement components are outliers, and drops them; what they measured is lost
    to it.
    """

    kf: GaussianFilter = field(default_factory=lambda: GaussianFilter(moments=Linear()))

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return self.kf.sees

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear."""
        self.kf.check(model)

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
        """The estimates; a flag on a whole vector drops all its components."""
        if known is None:
            raise SpecError("kf_clair needs to be told the outliers, which recorded data does not do")
        flags = known.v.flags
        if flags is not None:
            y = np.where(flags[:, None] if flags.ndim == 2 else flags, np.nan, y)
        return self.kf.run(model, y, x0, P0, Q=Q, R=R, keep=keep)


@dataclass(frozen=True)
class Truth:
    """The true states themselves, without any covariance, to be drawn beside estimates."""

    sees = frozenset({"cov"})

    def run(
        self,
        model: Model,
        y: Array,
        x0: Array,
        P0: Array,
        *,
        Q: Array,
        R: Array,
        keep: Collection[str] = (),
        known: Known | None = None,
        streams: Streams | None = None,
    ) -> Estimate:
        """The truth; as of every filter, a run with an infinite measurement has failed from there on."""
        if known is None:
            raise SpecError("truth needs the true states, which recorded data does not have")
        failed = np.isinf(y).any(1).cumsum(0) > 0
        T, n, _ = known.truth.shape
        cov = np.zeros((T, n, n, 1)) if "cov" in keep else None
        return Estimate(np.where(failed[:, None], np.nan, known.truth), cov, failed[-1])


def kf_clair() -> Rejecting:
    """Kalman filter that is told which measurement components are outliers, and drops them."""
    return Rejecting()
