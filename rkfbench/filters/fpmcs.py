"""The fixed-point maximum correntropy smoother as its paper prints it: eqs (16) and (20)-(24), in the alternate form
from prior to prior.

    r = y - H xm,  C = diag(c(r)),  S = H P H',  G = C (R + S C)^-1,  L = F P H' G                      (16), (22)
    at k >= j:   lam = Sig H' G;  xj <- xj + lam r;  Pi <- Pi - Sig H' lam';  Sig <- Sig (F - L H)'     (20), (22), (24)
    always:      xm <- F xm + B u + L r;  P <- F P (F - L H)' + Q                                       (20), (24)

All right sides use the old values, and nothing is symmetrised. `covariance: std` takes the covariance of (6) in place
of that of (16):
Pi <- Pi - Sig H' lam' - lam H Sig' + lam (S+R) lam';  Sig <- (Sig - lam H P)(F - L H)' + lam R L';  P <- (F - L H) P
(F - L H)' + L R L' + Q.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Known, Setting
from rkfbench.filters.correntropy import Correntropy, Floor, Kernel, Sigma
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.joseph import Joseph
from rkfbench.filters.moments import Linear
from rkfbench.filters.recursion import History, bury, prepare
from rkfbench.filters.schemes import Once
from rkfbench.filters.smoothing import SEES, At, FixedPoint, Lag, Start, ends, point
from rkfbench.linalg import Array, batched, diag, mul, positive_definite, solve, transpose
from rkfbench.models import Model
from rkfbench.streams import Streams

Covariance = Annotated[
    Literal["alt", "std"], "alt: (I - K H) P, (14) and (16); std: (I - K H) P (I - K H)' + K R K', (6)"
]


@dataclass(frozen=True)
class CorrentropySmoother:
    """FP-MCS: the state at step j from measurements up to j + lag, each weighted by a Gaussian kernel of its
    innovation.
    """

    sigma: Sigma = 1.0
    kernel: Kernel = "squared"
    covariance: Covariance = "alt"
    floor: Floor = 0.0
    at: At = None
    lag: Lag = None
    start: Start = "j"

    @property
    def sees(self) -> frozenset[str]:
        """Names of the histories that `run` can keep; `cov` runs over the lag, the others have one step."""
        return SEES

    @property
    def target(self) -> int | None:
        """The step j."""
        return self.at

    def check(self, model: Model) -> None:
        """SpecError unless the model is linear."""
        if not model.linear:
            raise SpecError("fpmcs needs a linear model")

    def placed(self, setting: Setting) -> CorrentropySmoother:
        """The smoother at the point of an experiment, where its own description does not say which."""
        at, lag = point(self.at, self.lag, setting)
        return replace(self, at=at, lag=lag)

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
        """The estimates of x_j: mean (lag + 1, n, M), cov likewise; see `rkfbench.filters.base.Filter`."""
        self.check(model)
        at, lag = ends(self.at, self.lag, len(y))
        y, x, P, Q, R = prepare(model, y, x0, P0, Q, R)
        F = model.F(x, 1)
        history, own = History({*keep} & {"cov"}, lag + 1), {}
        with np.errstate(all="ignore"):
            x, P = model.f(x, 1), _right(mul(F, P), F) + _at(Q, 1)
            for k in range(1, at + lag + 1):
                if k == at:
                    xj, Pi, Sig = x, P, P
                    own = {"prior_mean": x, "prior_cov": P}
                x, P = bury(x, P, positive_definite(P) & np.isfinite(x).all(0))
                H = model.H(x, k)
                PH = transpose(mul(H, transpose(P)))
                S = mul(H, PH)
                r, c = self._weighted(model.residual(y[k - 1], model.h(x, k)), _at(R, k), S)
                G = _gain(diag(c), _at(R, k), S)
                K = mul(PH, G)
                if k == at:
                    own |= {"post_mean": x + mul(K, r), "post_cov": self._posterior(P, PH, K, S, _at(R, k))}
                if k >= at:
                    SH = transpose(mul(H, transpose(Sig)))
                    lam = mul(SH, G)
                    if k > at or self.start == "j":
                        xj, Pi = xj + mul(lam, r), self._posterior(Pi, SH, lam, S, _at(R, k))
                    history.add(mean=xj, cov=Pi)
                if k == at + lag:
                    break
                F = model.F(x, k + 1)
                L = mul(F, K)
                A = batched(F) - transpose(mul(H.T, transpose(L)))  # F - L H
                if k > at or (k == at and self.start != "stale"):
                    Sig = self._cross(Sig, lam, PH, A, L, _at(R, k))
                P = self._prior(F, P, A, L, _at(R, k)) + _at(Q, k + 1)
                x = model.f(x, k + 1) + mul(L, r)
        estimate = history.estimate(failed=np.isnan(xj).any(0))
        return replace(estimate, target=at, extras={name: value[None] for name, value in own.items()})

    def _weighted(self, r: Array, R: Array, S: Array) -> tuple[Array, Array]:
        """Innovation and weights; a missing component has the innovation 0 and the weight 0."""
        c = Correntropy(self.sigma, self.kernel, self.floor).of(r, R, S)
        missing = np.isnan(r)
        return np.where(missing, 0.0, r), np.where(missing, 0.0, c)

    def _posterior(self, P: Array, PH: Array, K: Array, S: Array, R: Array) -> Array:
        """P - P H' K' and its like for Pi, (24-4); std: P - P H' K' - K H P + K (S + R) K'."""
        less = mul(PH, transpose(K))
        return P - less if self.covariance == "alt" else P - less - transpose(less) + mul(mul(K, S + R), transpose(K))

    def _cross(self, Sig: Array, lam: Array, PH: Array, A: Array, L: Array, R: Array) -> Array:
        """Sig (F - L H)', (24-2); std: (Sig - lam H P)(F - L H)' + lam R L'."""
        if self.covariance == "alt":
            return mul(Sig, transpose(A))
        return mul(Sig - mul(lam, transpose(PH)), transpose(A)) + mul(mul(lam, R), transpose(L))

    def _prior(self, F: Array, P: Array, A: Array, L: Array, R: Array) -> Array:
        """F P (F - L H)', (24-1); std: (F - L H) P (F - L H)' + L R L'."""
        if self.covariance == "alt":
            return mul(mul(F, P), transpose(A))
        return mul(mul(A, P), transpose(A)) + mul(mul(L, R), transpose(L))


def _gain(C: Array, R: Array, S: Array) -> Array:
    """C (R + S C)^-1, finite when weights are 0."""
    return transpose(solve(transpose(R + mul(S, C)), C))


def _right(A: Array, F: Array) -> Array:
    """A F' for a shared F (n, n)."""
    return transpose(mul(F, transpose(A)))


def _at(A: Array, k: int) -> Array:
    """The matrix of step k, where it changes with time."""
    return A if A.ndim == 3 else A[min(k, len(A)) - 1]


def mckf(
    sigma: Sigma = 1.0, kernel: Kernel = "squared", covariance: Covariance = "alt", floor: Floor = 0.0
) -> GaussianFilter:
    """Maximum correntropy Kalman filter: the KF whose gain is P H' C (R + S C)^-1, C = diag exp(-nu_i^2/(2 sigma^2
    R_ii)); one pass.
    """
    update = Once() if covariance == "alt" else Joseph()
    return GaussianFilter(moments=Linear(), weight=Correntropy(sigma, kernel, floor), update=update)


def ks(at: At = None, lag: Lag = None, start: Start = "j") -> FixedPoint:
    """Fixed-point Kalman smoother: the state at step j from measurements up to j + lag."""
    return FixedPoint(GaussianFilter(moments=Linear()), at, lag, start)
