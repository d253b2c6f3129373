"""Textbook twins of the Huber regression filters for one run: stacked rows, normal equations, explicit inverses."""

from __future__ import annotations

import numpy as np

GAMMA = 1.345


def psi(e, gamma=GAMMA):
    return 1.0 if abs(e) <= gamma else gamma / abs(e)


def symmetric_root(A):
    w, V = np.linalg.eigh(A)
    return V @ np.diag(np.sqrt(w)) @ V.T


def regression(x, P, H, R, nu, gamma=GAMMA, passes=10, unit_state=False, root="cholesky"):
    """IRLS of (12)-(15) with y = nu + H x; returns x+, P+."""
    m, n = H.shape
    C = np.zeros((m + n, m + n))
    C[:m, :m] = np.linalg.cholesky(R)
    C[m:, m:] = np.linalg.cholesky(P) if root == "cholesky" else symmetric_root(P)
    M = np.linalg.inv(C) @ np.vstack([H, np.eye(n)])
    Y = np.linalg.inv(C) @ np.concatenate([nu + H @ x, x])
    Psi = np.eye(m + n)
    z = np.linalg.inv(M.T @ M) @ M.T @ Y
    for _ in range(passes):
        e = Y - M @ z
        Psi = np.diag([psi(ei, gamma) for ei in e])
        if unit_state:
            Psi[m:, m:] = np.eye(n)
        z = np.linalg.inv(M.T @ Psi @ M) @ M.T @ Psi @ Y
    return z, np.linalg.inv(M.T @ Psi @ M)


def plain(x, P, Pxz, Pzz, R, nu):
    S = Pzz + R
    K = Pxz @ np.linalg.inv(S)
    return x + K @ nu, P - K @ S @ K.T


def moments(h, x, P):
    """Unscented moments with n + kappa = 3 for n = 3: six points of weight 1/6."""
    n = len(x)
    L = np.linalg.cholesky(P)
    points = [x + s * np.sqrt(n) * L[:, i] for i in range(n) for s in (1, -1)]
    values = [np.atleast_1d(h(p)) for p in points]
    z = sum(values) / (2 * n)
    Pzz = sum(np.outer(v - z, v - z) for v in values) / (2 * n)
    Pxz = sum(np.outer(p - x, v - z) for p, v in zip(points, values, strict=True)) / (2 * n)
    return z, Pzz, Pxz


def hukf(h, x, P, R, y, **options):
    z, _, Pxz = moments(h, x, P)
    return regression(x, P, Pxz.T @ np.linalg.inv(P), R, y - z, **options)


def nrukf(h, x, P, R, y, form="R", passes=0, gamma=GAMMA):
    """One-step for passes = 0; else from the plain update, the residual at the newest mean each time."""
    z, Pzz, Pxz = moments(h, x, P)
    L = np.linalg.cholesky(R)
    at = x if passes == 0 else plain(x, P, Pxz, Pzz, R, y - z)[0]
    for _ in range(max(passes, 1)):
        e = np.linalg.inv(L) @ (y - np.atleast_1d(h(at)))
        if form == "R":
            used, target = L @ np.diag([1 / psi(ei, gamma) for ei in e]) @ L.T, y
        else:
            used, target = R, np.atleast_1d(h(at)) + L @ np.clip(e, -gamma, gamma)
        at, cov = plain(x, P, Pxz, Pzz, used, target - z)
    return at, cov
