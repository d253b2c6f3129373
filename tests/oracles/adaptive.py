"""Textbook twins of the adaptive-factor filters for one run: the loss (5) minimised in information form, with plain
loops and inverses.
"""

from __future__ import annotations

import math

import numpy as np


def factor(u, lam, form="exp", floor=1e-6):
    u = abs(u)
    value = 1.0 if u <= lam else (math.exp(-((u - lam) ** 2)) if form == "exp" else lam / u)
    return max(value, floor)


def solution(x, P, H, R, y, alpha, beta):
    """(beta (P-)^-1 + H' alpha R^-1 H)^-1 and the mean; beta is one factor, or one a state."""
    b = np.diag(np.sqrt(np.broadcast_to(beta, len(x))))
    prior = b @ np.linalg.inv(P) @ b
    weight = np.diag(alpha) @ np.linalg.inv(R)
    cov = np.linalg.inv(prior + H.T @ weight @ H)
    return cov @ (prior @ x + H.T @ weight @ y), cov


def measurement_factors(x, P, H, R, y, lam=2.5):
    S = H @ P @ H.T + R
    V = -R @ np.linalg.inv(S) @ (y - H @ x)
    sd = np.sqrt(np.diag(R @ np.linalg.inv(S) @ R))
    return np.array([factor(u, lam) for u in V / sd])


def daf(x, P, H, R, y, order="alpha_first", u_cov="nominal"):
    alpha = measurement_factors(x, P, H, R, y)
    used = alpha if order == "alpha_first" else np.ones(len(y))
    inflated = R @ np.linalg.inv(np.diag(used))
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + inflated)
    S = H @ P @ H.T + (R if u_cov == "nominal" else inflated)
    u = (K @ (y - H @ x)) / np.sqrt(np.diag(K @ S @ K.T))
    return alpha, factor(u[0], 1.5), u


def sdf(x, P, H, R, y, mean="nominal"):
    alpha = measurement_factors(x, P, H, R, y)
    weights = (alpha if mean == "robust" else 1.0) / np.diag(R)
    r = weights @ (y - H @ x) / weights.sum()
    return alpha, factor(r / math.sqrt(P[0, 0]), 1.5), r / math.sqrt(P[0, 0])


def raf(x, P, H, R, y, norm="consistent"):
    variances = np.diag(R)
    log_f = np.zeros(len(y))
    for _ in range(20):
        q = np.exp(log_f - log_f.max()) / variances
        X = q @ y / q.sum()
        sized = np.abs(y - X) / np.sqrt(variances)
        new = -(np.maximum(sized - 2.5, 0.0) ** 2)
        if (new == log_f).all():
            break
        log_f = new
    q = np.exp(log_f - log_f.max()) / variances
    X = q @ y / q.sum()
    s2 = np.trace(P) if norm == "trace" else P[0, 0] + (q**2 * variances).sum() / q.sum() ** 2
    u = (X - x[0]) / math.sqrt(s2)
    return np.maximum(np.exp(log_f), 1e-6), factor(u, 1.5), u


def run(factors, F, H, Q, R, x0, P0, ys):
    x, P, xs, Ps = np.array(x0, float), np.array(P0, float), [], []
    for y in ys:
        x, P = F @ x, F @ P @ F.T + Q
        alpha, beta, _ = factors(x, P, H, R, y)
        x, P = solution(x, P, H, R, y, alpha, beta)
        xs.append(x)
        Ps.append(P)
    return np.array(xs), np.array(Ps)
