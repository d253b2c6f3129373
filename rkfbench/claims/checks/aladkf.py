"""Exact checks of the ALADKF paper: Theorem 1, Lemma 1, the derivatives of J_k, the recursion for P, the bounds of the
influence functions.
"""

from __future__ import annotations

import numpy as np

from rkfbench.claims.checks import Check, Outcome
from rkfbench.filters.weights import Huber, LeastAbsolute, Plain
from rkfbench.linalg import Array
from rkfbench.metrics.influence import influence, window, xi_of

DT = 0.5
F: Array = np.kron(np.array([[1.0, DT], [0.0, 1.0]]), np.eye(2))  # (78)
H = np.eye(4)[:3]  # (79)
Q = np.eye(4)


def _measurement_covariance() -> Array:
    """R = A3^(1/2), the paper's D1 read as a covariance."""
    w, V = np.linalg.eigh(0.5 * np.eye(3) + 0.5)
    return (V * np.sqrt(w)) @ V.T


R = _measurement_covariance()


def _cond(A: Array) -> Array:
    s = np.linalg.svd(A, compute_uv=False)
    return s[..., 0] / s[..., -1]


def theorem_1() -> Outcome:
    """(46) implies (47): the largest relative shortfall of cond(L Psi^-1 L') below cond(R), for both roots of random R
    and random Psi.
    """
    rng = np.random.default_rng(46)
    N, m = 40_000, 3
    V = np.linalg.qr(rng.standard_normal((N, m, m)))[0]
    w = 10.0 ** rng.uniform(-1, 1, (N, m))
    covariance = (V * w[:, None]) @ V.transpose(0, 2, 1)
    phi = 10.0 ** -rng.uniform(0, 5, (N, m))
    cond_R = _cond(covariance)
    premise = np.sqrt(phi.max(1) / phi.min(1)) >= cond_R
    symmetric = (V * np.sqrt(w)[:, None]) @ V.transpose(0, 2, 1)
    shortfall = 0.0
    for L in (symmetric, np.linalg.cholesky(covariance)):
        inflated = (L[premise] / phi[premise][:, None]) @ L[premise].transpose(0, 2, 1)
        shortfall = max(shortfall, float((1 - _cond(inflated) / cond_R[premise]).max()))
    return Outcome(shortfall, 1e-9, f"{int(premise.sum())} random matrices with (46), two roots each")


def lemma_1() -> Outcome:
    """(45): sigma_r(A) sigma_s(B), r + s = m + i, from below and r + s = i + 1 from above bound sigma_i(A B); largest
    relative violation.
    """
    rng = np.random.default_rng(45)
    worst = 0.0
    for m in (2, 3, 4):
        A, B = (rng.standard_normal((20_000, m, m)) for _ in range(2))
        a, b, ab = (np.linalg.svd(X, compute_uv=False) for X in (A, B, A @ B))
        for i in range(m):
            lower = np.max([a[:, r] * b[:, m - 1 + i - r] for r in range(i, m)], axis=0)
            upper = np.min([a[:, r] * b[:, i - r] for r in range(i + 1)], axis=0)
            worst = max(
                worst, float(((lower - ab[:, i]) / ab[:, 0]).max()), float(((ab[:, i] - upper) / ab[:, 0]).max())
            )
    return Outcome(max(worst, 0.0), 1e-9, "60 000 random pairs, m = 2, 3, 4")


def _problem(k: int, seed: int, scale: float = 6.0) -> tuple[Array, Array, Array]:
    """Sigma_d (k, m, m), A_d = H F^-d (k, m, n) and residuals r_d (k, m) of a random problem, with lambda well away
    from 1.
    """
    rng = np.random.default_rng(seed)
    back: Array = np.linalg.inv(F)
    A = np.array([H @ np.linalg.matrix_power(back, d) for d in range(k)])
    B, power, Sigma = np.zeros((4, 4)), np.eye(4), []
    for _ in range(k):
        Sigma.append(H @ B @ H.T + R)
        power = power @ back
        B = B + power @ Q @ power.T
    return np.array(Sigma), A, scale * rng.standard_normal((k, 3))


def _hessian_by_differences(Sigma: Array, A: Array, z: Array, step: float = 1e-3) -> Array:
    """Hessian of J_k at x = 0 by fourth-order central differences of the analytic gradient (15)."""

    def gradient(x: Array) -> Array:
        r = z - A @ x
        s = np.linalg.solve(Sigma, r[..., None])[..., 0]
        lam = np.sqrt(np.einsum("di,di->d", r, s))
        return -np.einsum("dij,di,d->j", A, s, 1 / lam)

    columns = []
    for e in np.eye(4) * step:
        columns.append((8 * (gradient(e) - gradient(-e)) - (gradient(2 * e) - gradient(-2 * e))) / (12 * step))
    return np.array(columns).T


def _hessian(Sigma: Array, A: Array, r: Array, power: int) -> Array:
    """(18) with (19), one sum over j: sum A' Sigma_a^-1 A - sum A' Sigma_a^-1 r r' Sigma_a^-1 A lambda^power, Sigma_a
    = lambda Sigma.

    The paper prints the power -3; -1 is right with Sigma_a (or -3 with Sigma).
    """
    s = np.linalg.solve(Sigma, r[..., None])[..., 0]
    lam = np.sqrt(np.einsum("di,di->d", r, s))
    As = np.einsum("dij,di->dj", A, s / lam[:, None])
    first = np.einsum("dij,dik,d->jk", A, np.linalg.solve(Sigma, A), 1 / lam)
    return first - np.einsum("dj,dk,d->jk", As, As, lam**power)


def hessian_as_printed() -> Outcome:
    """(18)-(19) as printed against finite differences of J_k: largest relative difference over problems with lambda
    away from 1.
    """
    worst, corrected = 0.0, 0.0
    for seed in range(5):
        Sigma, A, z = _problem(6, seed)
        reference = _hessian_by_differences(Sigma, A, z)
        size = np.abs(reference).max()
        worst = max(worst, float(np.abs(_hessian(Sigma, A, z, -3) - reference).max() / size))
        corrected = max(corrected, float(np.abs(_hessian(Sigma, A, z, -1) - reference).max() / size))
    return Outcome(worst, 1e-5, f"with lambda^-1 in place of lambda^-3 the difference is {corrected:.1e}")


def hessian_indefinite() -> Outcome:
    """Least eigenvalue of the Hessian of J_k over random residuals and k = 2..20 (claimed: below -1e-6 somewhere; J_k
    is convex).
    """
    least, printed = np.inf, np.inf
    for k in (2, 3, 5, 10, 20):
        for seed in range(40):
            Sigma, A, z = _problem(k, 1000 + seed, scale=10.0 ** (seed % 4 - 1))
            least = min(
                least, float(np.linalg.eigvalsh(_hessian_by_differences(Sigma, A, z, 1e-3 * 10.0 ** (seed % 4 - 1)))[0])
            )
            printed = min(printed, float(np.linalg.eigvalsh(_hessian(Sigma, A, z, -3))[0]))
    return Outcome(least, -1e-6, f"least eigenvalue of the form as printed: {printed:.3g}")


def recursion_against_batch() -> Outcome:
    """All lambda = 1, started from the inverse of (20) at k = 2: largest relative difference of P_k^-1 from (20), k =
    3..50.
    """
    _, _, G = window(F, H, Q, R, 50)
    P, worst = np.linalg.inv(G[1]), 0.0
    for k in range(3, 51):
        Pbar = F @ P @ F.T + Q
        P = np.linalg.inv(np.linalg.inv(Pbar) + H.T @ np.linalg.solve(R, H))
        worst = max(worst, float(np.abs(np.linalg.inv(P) - G[k - 1]).max() / np.abs(G[k - 1]).max()))
    return Outcome(worst, 1e-9, "k = 3 .. 50")


def modified_hessian_definite() -> Outcome:
    """Minus the least eigenvalue of (20) over k = 1..50, all lambda = 1 (claimed: positive definite)."""
    _, _, G = window(F, H, Q, R, 50)
    least = np.linalg.eigvalsh(G)[:, 0]
    return Outcome(
        -float(least.min()),
        -1e-9,
        f"least eigenvalue {least[0]:.2g} at k = 1 (rank 3 of 4), at least {least[1:].min():.3g} for k = 2 .. 50",
    )


def influence_bounded() -> Outcome:
    """One measurement moved by s = 10..1e8 about a fixed state: growth of the KF's influence against s, excess of the
    others over their bounds.
    """
    rng = np.random.default_rng(60)
    k, s = 40, 10.0 ** np.arange(1, 9)
    y = np.repeat(3 * rng.standard_normal((k, 3, 1)), len(s), axis=2)
    y[k - 5, 1] += s
    x = np.zeros((k, 4, len(s)))
    _, h, G = window(F, H, Q, R, k)
    norms = {}
    for name, weight in (("kf", Plain()), ("hkf", Huber()), ("aladkf", LeastAbsolute())):
        IF = influence(weight, F, H, Q, R, x, y, [k])[0]
        norms[name] = np.sqrt((IF**2).sum(0)), xi_of(weight, 3)
    growth = norms["kf"][0][-1] / norms["kf"][0][-2] / 10 - 1
    reach = np.linalg.norm(np.linalg.solve(G[-1], h.transpose(0, 2, 1)), ord=2, axis=(1, 2)).sum()
    bounds = {"hkf": Huber().threshold * np.sqrt(3), "aladkf": 1.0}
    excess = max(float((norms[name][0] / (bound * reach / norms[name][1])).max() - 1) for name, bound in bounds.items())
    return Outcome(
        max(abs(float(growth)), excess, 0.0),
        1e-3,
        "growth of the KF per decade, and largest norm over its bound for HKF and ALADKF",
    )


CHECKS: dict[str, Check] = {
    "T1": theorem_1,
    "L1": lemma_1,
    "H1": hessian_as_printed,
    "H2": hessian_indefinite,
    "H3": recursion_against_batch,
    "H5": modified_hessian_definite,
    "C2a": influence_bounded,
}
