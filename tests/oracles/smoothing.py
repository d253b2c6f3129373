"""Textbook fixed-point smoothing for one run: MCKF by (5)-(6) or (16), and smoothing by a state augmented with x_j;
batch least squares.
"""

from __future__ import annotations

import numpy as np


def kernel(r, R, S, sigma, kind="squared", floor=0.0):
    c = []
    for i in range(len(r)):
        scale = R[i, i] + (S[i, i] if kind == "innovation_cov" else 0.0)
        size = abs(r[i]) / np.sqrt(scale) if kind == "abs" else r[i] ** 2 / scale
        c.append(max(np.exp(-size / (2 * sigma**2)), floor))
    return np.array(c)


def augmented(F, H, Q, R, x0, P0, ys, at, lag, sigma=np.inf, kind="squared", covariance="alt", floor=0.0, start="j"):
    """The MCKF on the state [x; x_j] itself, by (6) with explicit inverses: estimates and covariances of x_j after
    each lag.

    Diagonal R. `skip`: y_j updates x alone; `stale`: besides, the cross covariance after it is that before it.
    """
    n, m = H.shape[1], len(R)
    x, P = np.array(x0, float), np.array(P0, float)
    xs, Pis = [], []
    for k in range(1, at + lag + 1):
        if k <= at:
            x, P = F @ x, F @ P @ F.T + Q
        else:
            A = np.block([[F, np.zeros((n, n))], [np.zeros((n, n)), np.eye(n)]])
            keep = P[n:, :n].copy()
            x, P = A @ x, A @ P @ A.T + np.block([[Q, np.zeros((n, n))], [np.zeros((n, n)), np.zeros((n, n))]])
            if start == "stale" and k == at + 1:
                P[n:, :n], P[:n, n:] = keep, keep.T
        if k == at:  # the copy of x_j comes in
            prior = P.copy()
            x, P = np.concatenate([x, x]), np.block([[P, P], [P, P]])
        Ha = H if k < at else np.hstack([H, np.zeros((m, n))])
        r = ys[k - 1] - Ha @ x
        S = Ha @ P @ Ha.T
        C = np.diag(kernel(r, R, S, sigma, kind, floor))
        K = P @ Ha.T @ C @ np.linalg.inv(R + S @ C)
        if k == at and start != "j":
            K[n:] = 0
        I = np.eye(len(x))  # noqa: E741
        x = x + K @ r
        updated = (I - K @ Ha) @ P @ (I - K @ Ha).T + K @ R @ K.T if covariance == "std" else (I - K @ Ha) @ P
        if k == at and start != "j":
            Pp = updated[:n, :n]
            Sig = prior if start == "stale" else Pp
            updated = np.block([[Pp, Sig.T], [Sig, prior]])
        P = updated
        if k >= at:
            xs.append(x[n:])
            Pis.append(P[n:, n:])
    return np.array(xs), np.array(Pis)


def least_squares(F, H, Q, R, x0, P0, ys, at):
    """x_at and its covariance from all ys by batch least squares over x_0 .. x_T, weights inv(P0), inv(Q), inv(R)."""
    n, T = len(F), len(ys)
    N, g = np.zeros((n * (T + 1),) * 2), np.zeros(n * (T + 1))

    def add(rows, value, W):
        A = np.zeros((len(value), n * (T + 1)))
        for k, M in rows.items():
            A[:, n * k : n * (k + 1)] = M
        N[:] += A.T @ W @ A
        g[:] += A.T @ W @ value

    add({0: np.eye(n)}, np.asarray(x0, float), np.linalg.inv(P0))
    for k in range(1, T + 1):
        add({k: np.eye(n), k - 1: -F}, np.zeros(n), np.linalg.inv(Q))
        add({k: H}, ys[k - 1], np.linalg.inv(R))
    C = np.linalg.inv(N)
    part = slice(n * at, n * (at + 1))
    return (C @ g)[part], C[part, part]
