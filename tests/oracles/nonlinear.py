"""Textbook EKF, UKF, CKF, DD2, IEKF and progressive updates for one run, with angles in h wrapped to [-pi, pi)."""

from __future__ import annotations

import numpy as np


def residual(y, z, angles=()):
    d = np.asarray(y, float) - z
    for i in angles:
        d[i] = (d[i] + np.pi) % (2 * np.pi) - np.pi
    return d


def kalman(x, P, H, R, nu):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ nu, P - K @ S @ K.T


def ekf(x, P, y, h, jac, R, angles=()):
    return kalman(x, P, jac(x), R, residual(y, h(x), angles))


def progressive(x, P, y, h, jac, R, dl, angles=()):
    for _ in range(round(1 / dl)):
        H = jac(x)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + dl * K @ residual(y, h(x), angles), (np.eye(len(x)) - dl * K @ H) @ P
    return x, P


def tempered(x, P, y, h, jac, R, dl, angles=()):
    for _ in range(round(1 / dl)):
        x, P = ekf(x, P, y, h, jac, R / dl, angles)
    return x, P


def inflated(x, P, y, h, jac, R, dl, angles=()):
    p = (1 - dl) ** (1 / dl)
    H = jac(x)
    S = (1 + p / (1 - p)) * H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ residual(y, h(x), angles), P - K @ H @ P


def iterated(x, P, y, h, jac, R, iterations=10, angles=()):
    z = x
    for _ in range(iterations):
        H = jac(z)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        z = x + K @ (residual(y, h(z), angles) - H @ (x - z))
    return z, P - K @ H @ P


def unscented_points(x, P, alpha, beta, kappa):
    n = len(x)
    lam = alpha**2 * (n + kappa) - n
    L = np.linalg.cholesky(P)
    points = (
        [x] + [x + np.sqrt(n + lam) * L[:, i] for i in range(n)] + [x - np.sqrt(n + lam) * L[:, i] for i in range(n)]
    )
    Wm = np.full(2 * n + 1, 1 / (2 * (n + lam)))
    Wm[0] = lam / (n + lam)
    Wc = Wm.copy()
    Wc[0] += 1 - alpha**2 + beta
    return points, Wm, Wc


def cubature_points(x, P):
    n = len(x)
    L = np.linalg.cholesky(P)
    points = [x + s * np.sqrt(n) * L[:, i] for s in (1, -1) for i in range(n)]
    W = np.full(2 * n, 1 / (2 * n))
    return points, W, W


def weighted(values, Wm, Wc, others=None):
    mean = sum(w * v for w, v in zip(Wm, values, strict=True))
    deviations = [v - mean for v in values]
    return mean, sum(w * np.outer(d, d) for w, d in zip(Wc, deviations, strict=True)), deviations


def sigma_step(x, P, y, f, h, Q, R, draw, redraw=True, angles=()):
    """One prediction and update with the points of `draw`; returns prior mean, prior covariance, mean, covariance."""
    points, Wm, Wc = draw(x, P)
    moved = [f(p) for p in points]
    xp, Pp, _ = weighted(moved, Wm, Wc)
    Pp = Pp + Q
    points = draw(xp, Pp)[0] if redraw else moved
    offsets = [residual(h(p), h(xp), angles) for p in points]
    dbar, S, deviations = weighted(offsets, Wm, Wc)
    S = S + R
    C = sum(w * np.outer(p - xp, d) for w, p, d in zip(Wc, points, deviations, strict=True))
    K = C @ np.linalg.inv(S)
    return xp, Pp, xp + K @ residual(y, h(xp) + dbar, angles), Pp - K @ S @ K.T


def divided_difference(x, P, g, h2):
    """DD2 mean and covariance of g, and its cross covariance with x."""
    n, hh = len(x), np.sqrt(h2)
    L = np.linalg.cholesky(P)
    g0, plus, minus = g(x), [g(x + hh * L[:, i]) for i in range(n)], [g(x - hh * L[:, i]) for i in range(n)]
    mean = (h2 - n) / h2 * g0 + sum(a + b for a, b in zip(plus, minus, strict=True)) / (2 * h2)
    first = [(a - b) / (2 * hh) for a, b in zip(plus, minus, strict=True)]
    second = [np.sqrt(h2 - 1) / (2 * h2) * (a + b - 2 * g0) for a, b in zip(plus, minus, strict=True)]
    cov = sum(np.outer(d, d) for d in first + second)
    return mean, cov, sum(np.outer(L[:, i], first[i]) for i in range(n))
