"""Robust weights: what a large residual does to the measurement noise covariance R of one update.

A weight sees the innovation nu, the residual e = y - h(x) at the prior mean, R and Szz, and answers with D, R' and nu'
of the update

    S = D Szz D + R',   K = Pxz D S^-1,   x + K nu',   P - K S K'.

Inflating R means D = I, nu' = nu. A weight that may vanish scales the innovation instead (D = sqrt of the weight), so
that nothing is divided by it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from annotated_types import Gt

from rkfbench.linalg import Array, batched, dot, mul, whitening


class Weighted(NamedTuple):
    """R' (m, m, M), nu' (m, M), the diagonal of D (m, M) or None for the identity, and what was seen, by name."""

    R: Array
    nu: Array
    D: Array | None = None
    seen: Mapping[str, Array] = {}


class Weight(Protocol):
    """A robust weight; `sees` names what its updates show beside nu and S."""

    sees: ClassVar[frozenset[str]]

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted: ...


@dataclass(frozen=True)
class Plain:
    """No weight: R' = R."""

    sees: ClassVar[frozenset[str]] = frozenset()

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        return Weighted(R, nu)


@dataclass(frozen=True)
class Huber:
    """Huber's weight by component: R' = L diag(1/Phi) L', 1/Phi_i = max(1, |e_i|/beta), e = L^-1 nu, L L' = R.

    Eqs (9)-(11) of the ALADKF paper; one pass, from the prior innovation whitened with R alone.
    """

    threshold: Annotated[float, Gt(0), "threshold beta of (11), in units of the whitened residual"] = 1.345
    root: Annotated[
        Literal["symmetric", "cholesky"],
        "which root L of R whitens; decides which combinations of components are judged",
    ] = "symmetric"
    reuse_root: Annotated[bool, "compute the root of R once while R stays the same, not in every step"] = True

    sees: ClassVar[frozenset[str]] = frozenset({"inflation"})

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        L, inverse = whitening(R, self.root, self.reuse_root)
        inflation = np.maximum(1.0, np.abs(mul(inverse, nu)) / self.threshold)
        return Weighted(recolour(L, inflation), nu, seen={"inflation": inflation})


@dataclass(frozen=True)
class LeastAbsolute:
    """Approximate least absolute deviation: R' = lambda R, lambda = sqrt(nu' R^-1 nu).

    Eqs (37)-(38) of the ALADKF paper; lambda has no floor and no cap.
    """

    sees: ClassVar[frozenset[str]] = frozenset({"lambda"})

    def __call__(self, nu: Array, e: Array, R: Array, Szz: Array) -> Weighted:
        _, inverse = whitening(R, "cholesky")
        whitened = mul(inverse, nu)
        length = np.sqrt(dot(whitened, whitened))
        return Weighted(length * batched(R), nu, seen={"lambda": length[None]})


def recolour(L: Array, d: Array) -> Array:
    """L diag(d) L' = sum_i d_i l_i l_i' for d (m, M): with a shared L one product with the outer products of its
    columns.
    """
    m = len(L)
    if L.ndim == 2:
        products = (L[:, None] * L[None]).reshape(m * m, m)
        return (products @ d).reshape(m, m, -1)
    return np.einsum("ik...,k...,jk...->ij...", L, d, L)
