"""The update whose covariance is the one of the gain that was taken, not of the gain that would be optimal."""

from __future__ import annotations

from dataclasses import dataclass

from rkfbench.filters.base import Posterior
from rkfbench.filters.moments import Moments
from rkfbench.filters.weights import Weight
from rkfbench.linalg import Array, mul, solve, sym, transpose
from rkfbench.models import Model


@dataclass(frozen=True)
class Joseph:
    """One update with P = (I - K H) P (I - K H)' + K R K': the gain is the robust one, the noise covariance R is the
    one that the filter is told.

    Eq. (6) of the FP-MCS paper. Written with moments: P - K Pxz' - Pxz K' + K (Szz + R) K'.
    """

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        z, Szz, Pxz, hx = moments.measure(model, x, P, k)
        nu = model.residual(y, z)
        told = R
        R, weighted, D, seen = weight(nu, nu if hx is z else model.residual(y, hx), R, Szz)
        S, C = (Szz, Pxz) if D is None else (D[:, None] * Szz * D, Pxz * D)
        S = S + R
        K = transpose(solve(S, transpose(C)))
        x = x + mul(K, weighted)
        K = K if D is None else K * D
        crossed = mul(K, transpose(Pxz))
        P = P - crossed - transpose(crossed) + mul(K, transpose(mul(K, Szz + told)))
        return Posterior(x, sym(P), {"nu": nu, "S": S, **seen})
