"""Huber's weight on the residual at a point, e = Lr^-1 (y - h(x)): what the NRUKF paper does to the measurement before
a plain update.

    R form (34)-(36)    R' = Lr Psi^-1 Lr', psi(e) = min(1, gamma/|e|)
    Y form (37)-(39)    y' = h(x) + Lr clip(e, -gamma, gamma): a pseudo-observation, with the nominal R

x is the prior mean, h the exact function (not the mean that the moments predict); standardised by R alone, also where S
is many times R. `Reweighted` moves x on to the newest posterior mean and repeats, each time from the same prior and
moments: the limit is the M-estimate with unit state rows where h is linear.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from annotated_types import Ge

from rkfbench.filters.base import Posterior
from rkfbench.filters.moments import Moments
from rkfbench.filters.regression import Threshold
from rkfbench.filters.weights import Weight, Weighted, recolour
from rkfbench.linalg import Array, condition, mul, whitening
from rkfbench.models import Model


@dataclass(frozen=True)
class ResidualHuber:
    """R form: R' = Lr diag(max(1, |e_i|/gamma)) Lr', e = Lr^-1 (y - h(x)), eqs (34)-(36) of the NRUKF paper."""

    threshold: Threshold = 1.345

    sees: ClassVar[frozenset[str]] = frozenset({"weight"})

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        L, inverse = whitening(R, "cholesky")
        inflation = np.maximum(1.0, np.abs(mul(inverse, e)) / self.threshold)
        return Weighted(recolour(L, inflation), nu, seen={"weight": 1 / inflation})


@dataclass(frozen=True)
class PseudoObservation:
    """Y form: the part of e = Lr^-1 (y - h(x)) beyond +-gamma is cut off the measurement; R stays, eqs (37)-(39) of the
    NRUKF paper.
    """

    threshold: Threshold = 1.345

    sees: ClassVar[frozenset[str]] = frozenset({"weight"})

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        L, inverse = whitening(R, "cholesky")
        whitened = mul(inverse, e)
        beyond = whitened - np.clip(whitened, -self.threshold, self.threshold)
        weight = 1 / np.maximum(1.0, np.abs(whitened) / self.threshold)
        return Weighted(R, nu - mul(L, beyond), seen={"weight": weight})


@dataclass(frozen=True)
class Reweighted:
    """The update taken again and again from the same prior and moments, the weight seeing y - h at the newest mean; the
    first one is plain.

    `last_change` is the largest change of a mean in the last pass, in prior standard deviations.
    """

    passes: Annotated[int, Ge(1), "reweighted updates after the plain one"] = 10

    sees: ClassVar[frozenset[str]] = frozenset({"last_change"})

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        z, Szz, Pxz, _ = moments.measure(model, x, P, k)
        nu, sd = model.residual(y, z), np.sqrt(np.einsum("iim->im", P))
        after = condition(x, P, Pxz, Szz + R, nu)
        seen: Mapping[str, Array] = {}
        change = np.zeros_like(nu[:1])
        for _ in range(self.passes):
            before = after[0]
            used, weighted, D, seen = weight(nu, model.residual(y, model.h(before, k)), R, Szz)
            S, C = (Szz, Pxz) if D is None else (D[:, None] * Szz * D, Pxz * D)
            after = condition(x, P, C, S + used, weighted)
            change = (np.abs(after[0] - before) / sd).max(0, keepdims=True)
        return Posterior(*after, {"nu": nu, "S": Szz + R, "last_change": change, **seen})
