"""The measurement update as a regression: Huber's M-estimate of the state from measurement and prediction together.

    [y; x-] = [H; I] x + noise of covariance blkdiag(R, P-), whitened to Y = M x + xi        (8)-(10)
    minimise sum_i rho(e_i), e = Y - M x, by reweighted least squares:
    M' Psi M x = M' Psi Y, psi(e) = min(1, gamma/|e|)                                        (11)-(14), (16)
    P+ = (M' Psi M)^-1 with the weights of the last solve                                    (15)

The formulas of the NRUKF paper are lost: this is the standard method (Karlgaard and Schaub 2007). For a nonlinear h the
moments of the filter supply the slope H = Pxz' (P-)^-1 and the predicted measurement. With P- = L L', R = Lr Lr',
B = Lr^-1 H L, r = Lr^-1 nu and the inverse weights ax, ay, one solve is

    t = (B ax B' + ay)^-1 r,   d = ax B' t,   x = x- + L d,   residuals -d (state) and ay t (measurement),

so that nothing is divided by a weight and no normal equations are formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Gt

from rkfbench.errors import SpecError
from rkfbench.filters.base import Posterior
from rkfbench.filters.moments import Moments
from rkfbench.filters.weights import Plain, Weight
from rkfbench.linalg import (
    Array,
    add_diag,
    cholesky,
    condition,
    diag,
    eigh,
    mul,
    solve,
    solve_lower,
    sym,
    transpose,
    whitening,
)
from rkfbench.models import Model

Threshold = Annotated[
    float, Gt(0), "Huber threshold gamma of (16), in whitened units; 1.345 has 95 % efficiency for Gaussian noise"
]
Passes = Annotated[int, Ge(1), "reweighted solves after the first"]
StateRows = Annotated[
    Literal["weighted", "unit"], "whether the rows of the prediction are weighted too, or keep weight 1"
]
Root = Annotated[Literal["cholesky", "symmetric"], "which root of P- whitens; weighted state rows depend on it"]
LinearisationCov = Annotated[bool, "add the covariance Szz - H P- H' of the linearisation error to R"]


@dataclass(frozen=True)
class Regression:
    """Huber's M-estimate over measurement and state rows by iteratively reweighted least squares; it brings its own
    weight.

    `last_change` is the largest change of the whitened estimate in the last pass: how far the iteration is from its
    limit.
    """

    threshold: Threshold = 1.345
    state_rows: StateRows = "weighted"
    root: Root = "cholesky"
    passes: Passes = 10
    linearisation_cov: LinearisationCov = False

    sees: ClassVar[frozenset[str]] = frozenset({"weight", "state_weight", "last_change"})

    def __call__(
        self, moments: Moments, weight: Weight, model: Model, x: Array, P: Array, y: Array, k: int, R: Array
    ) -> Posterior:
        if not isinstance(weight, Plain):
            raise SpecError("the regression update brings its own weight: leave out the robust weight")
        z, Szz, Pxz, _ = moments.measure(model, x, P, k)
        nu = model.residual(y, z)
        L, HL = self._slope(P, Pxz)
        R_used = R + Szz - mul(HL, transpose(HL)) if self.linearisation_cov else R
        _, inverse = whitening(R_used, "cholesky")
        B, r = mul(inverse, HL), mul(inverse, nu)
        ax, ay, change = self._inverse_weights(B, r)
        spread = L * ax
        x, P = condition(
            x, sym(mul(spread, transpose(L))), mul(spread, transpose(B)), add_diag(mul(B * ax, transpose(B)), ay), r
        )
        return Posterior(
            x, P, {"nu": nu, "S": Szz + R, "weight": 1 / ay, "state_weight": 1 / ax, "last_change": change}
        )

    def _slope(self, P: Array, Pxz: Array) -> tuple[Array, Array]:
        """L with L L' = P- (n, n, M), and H L = (L^-1 Pxz)'."""
        if self.root == "cholesky":
            L = cholesky(P)
            return L, transpose(solve_lower(L, Pxz))
        w, V = eigh(P)
        scaled = V / np.sqrt(w)
        return mul(V * np.sqrt(w), transpose(V)), transpose(mul(scaled, mul(transpose(V), Pxz)))

    def _inverse_weights(self, B: Array, r: Array) -> tuple[Array, Array, Array]:
        """1/psi of the state rows (n, M) and measurement rows (m, M) after all passes; the last change of d (1, M)."""
        ax, ay = np.ones((B.shape[1], r.shape[-1])), np.ones_like(r)
        Bt = transpose(B)
        fixed = mul(B, Bt) if self.state_rows == "unit" else None

        def solution() -> tuple[Array, Array]:
            """d and the residuals of the measurement rows."""
            t = solve(add_diag(mul(B * ax, Bt), ay) if fixed is None else fixed + diag(ay), r)
            return ax * mul(Bt, t), ay * t

        d, e = solution()
        for _ in range(self.passes):
            ax = np.maximum(1.0, np.abs(d) / self.threshold) if fixed is None else ax
            ay = np.maximum(1.0, np.abs(e) / self.threshold)
            before = d
            d, e = solution()
        return ax, ay, np.abs(d - before).max(0, keepdims=True)
