"""Textbook KF, HKF and ALADKF for one run: eqs (3)-(11), (23), (33), (37)-(41) of the ALADKF paper."""

from __future__ import annotations

import numpy as np


def symmetric_root(A):
    w, V = np.linalg.eigh(A)
    return V @ np.diag(np.sqrt(w)) @ V.T


def reff_kf(nu, R):
    return R


def reff_hkf(nu, R, threshold=1.345, root="symmetric"):
    L = symmetric_root(R) if root == "symmetric" else np.linalg.cholesky(R)
    e = np.linalg.inv(L) @ nu
    phi = np.array([1.0 if abs(ei) < threshold else threshold / abs(ei) for ei in e])
    return L @ np.linalg.inv(np.diag(phi)) @ L.T


def reff_aladkf(nu, R):
    return np.sqrt(nu @ np.linalg.inv(R) @ nu) * R


def linear_filter(F, H, Q, R, x0, P0, ys, reff=reff_kf):
    """One run: ys (T, m); NaN components are missing. Returns lists of x, P, S (None where nothing was measured)."""
    x, P = np.array(x0, float), np.array(P0, float)
    xs, Ps, Ss = [], [], []
    for y in ys:
        x = F @ x
        P = F @ P @ F.T + Q
        rows = [i for i in range(len(y)) if not np.isnan(y[i])]
        S = None
        if rows:
            Hr, Rr = H[rows], R[np.ix_(rows, rows)]
            nu = y[rows] - Hr @ x
            S = Hr @ P @ Hr.T + reff(nu, Rr)
            K = P @ Hr.T @ np.linalg.inv(S)
            x = x + K @ nu
            P = P - K @ Hr @ P
        xs.append(x)
        Ps.append(P)
        Ss.append(S)
    return np.array(xs), np.array(Ps), Ss


def weighted_least_squares(F, H, Q, R, x0, P0, ys):
    """The whole trajectory x_1..x_T by batch least squares with prior N(x0, P0); returns the last block and its
    covariance.
    """
    n, T = len(F), len(ys)
    A, b, W = [], [], []

    def block(k, M):
        row = np.zeros((len(M), n * (T + 1)))
        row[:, n * k : n * (k + 1)] = M
        return row

    A.append(block(0, np.eye(n)))
    b.append(x0)
    W.append(np.linalg.inv(P0))
    for k in range(1, T + 1):
        A.append(block(k, np.eye(n)) - block(k - 1, F))
        b.append(np.zeros(n))
        W.append(np.linalg.inv(Q))
        A.append(block(k, H))
        b.append(ys[k - 1])
        W.append(np.linalg.inv(R))
    N = sum(a.T @ w @ a for a, w in zip(A, W, strict=True))
    g = sum(a.T @ w @ np.asarray(c) for a, w, c in zip(A, W, b, strict=True))
    C = np.linalg.inv(N)
    return (C @ g)[-n:], C[-n:, -n:]
