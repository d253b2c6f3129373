"""One family of Gaussian filters: a choice of moments, a robust weight and an update scheme.

    predict   x, P        <- moments of f at (x, P), + Q
    update    z, Szz, Pxz <- moments of h at (x, P);  nu = y - z
              D, R', nu'  <- weight(nu, y - h(x), R, Szz)
              S = D Szz D + R';  K = Pxz D S^-1;  x <- x + K nu';  P <- P - K S K'

KF, EKF, UKF, HKF, ALADKF ... are names for such choices; combinations that no paper tried need no code.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from functools import partial

from rkfbench.filters import gains, recursion
from rkfbench.filters.base import Estimate, Known, Posterior
from rkfbench.filters.moments import Jacobians, Moments, Taylor
from rkfbench.filters.schemes import Once, Scheme
from rkfbench.filters.weights import Plain, Weight
from rkfbench.linalg import Array, plus
from rkfbench.models import Model
from rkfbench.streams import Streams


@dataclass(frozen=True)
class GaussianFilter:
    """A member of the family; without arguments the (extended) Kalman filter."""

    moments: Moments = field(default_factory=Taylor)
    weight: Weight = field(default_factory=Plain)
    update: Scheme = field(default_factory=Once)
    reuse_gains: bool = True  # of the Kalman filter: once for all runs that share them, and no more once they settled

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep."""
        return recursion.SEES | self.weight.sees | getattr(self.update, "sees", frozenset())

    def check(self, model: Model) -> None:
        """SpecError if the filter cannot run on this model."""
        self.moments.check(model)

    def predict(self, model: Model, x: Array, P: Array, k: int, Q: Array) -> tuple[Array, ...]:
        """Mean and covariance of f(x) + w, and the points that the moments hand over to the update, if any."""
        x, P, *points = self.moments.propagate(model, x, P, k)
        return x, plus(P, Q), *points

    def correct(self, model: Model, x: Array, P: Array, y: Array, k: int, R: Array, *points: Array) -> Posterior:
        """The update with y (m, M)."""
        return self.update(self.moments.at(x, *points), self.weight, model, x, P, y, k, R)

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
        """The estimates; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        told = recursion.prepare(model, y, x0, P0, Q, R)
        if self._gains_first(model, *told):
            return gains.run(model, *told, keep)
        return recursion.collect(recursion.steps(self, model, *told), keep, len(y))

    def steps(
        self, model: Model, y: Array, x0: Array, P0: Array, *, Q: Array, R: Array, known: Known | None = None
    ) -> Iterator[recursion.Step]:
        """The steps, one after the other."""
        return self.prepared(model, *recursion.prepare(model, y, x0, P0, Q, R))

    def prepared(self, model: Model, *told: Array) -> Iterator[recursion.Step]:
        """The steps from arguments as `prepare` makes them."""
        how = gains.steps if self._gains_first(model, *told) else partial(recursion.steps, self)
        return how(model, *told)

    def _gains_first(self, model: Model, *told: Array) -> bool:
        """Whether this is the Kalman filter, and all runs share its gains."""
        return self.settles and gains.shared(model, *told)

    @property
    def settles(self) -> bool:
        """Whether its late steps may cost less than its first ones."""
        plain = isinstance(self.moments, Jacobians) and isinstance(self.weight, Plain) and isinstance(self.update, Once)
        return plain and self.reuse_gains
