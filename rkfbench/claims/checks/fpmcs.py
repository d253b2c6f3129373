"""Exact checks of the FP-MCS paper: its gains and covariances, its theorem and remarks, its series, and whether its
two tables agree.

The counts of operations stand in `fpmcs_counts`. Random systems have n = 4, m = 3, full F, H, P; the paper's R is
diagonal.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from math import inf

import numpy as np

from rkfbench import filters
from rkfbench.claims.checks import Check, Outcome, fpmcs_counts
from rkfbench.filters import Estimate
from rkfbench.linalg import Array
from rkfbench.models import Navigation

F: Array = np.kron(np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2))  # (32)
H: Array = np.eye(4)[:2]
Q, R = 0.109 * np.eye(4), 2.008 * np.eye(2)  # covariances of the mixtures
ALGEBRA = 1e-9


def _systems(count: int = 300, full: bool = False) -> list[tuple[Array, ...]]:
    """Random F, H, P, R, C with weights in (0.05, 1]."""
    rng = np.random.default_rng(12)
    found: list[tuple[Array, ...]] = []
    for _ in range(count):
        A, B = rng.standard_normal((4, 4)), rng.standard_normal((3, 3))
        diagonal = np.diag(rng.uniform(0.3, 3, 3))
        C = np.diag(rng.uniform(0.05, 1, 3))
        P, noise = A @ A.T + 0.1 * np.eye(4), B @ B.T + 0.3 * np.eye(3) if full else diagonal
        found.append((rng.standard_normal((4, 4)), rng.standard_normal((3, 4)), P, noise, C))
    return found


def _relative(A: Array, B: Array) -> float:
    return float(np.abs(A - B).max() / np.abs(B).max())


def _gain(H: Array, P: Array, R: Array, C: Array) -> Array:
    """K of (6)."""
    W = H.T @ C @ np.linalg.inv(R)
    gain: Array = np.linalg.inv(np.linalg.inv(P) + W @ H) @ W
    return gain


def _standard(K: Array, H: Array, P: Array, R: Array) -> Array:
    """P+ of (6)."""
    A = np.eye(len(P)) - K @ H
    return A @ P @ A.T + K @ R @ K.T


def _printed_14(H: Array, P: Array, R: Array, C: Array) -> Array:
    """P+ of (14), with C to the right of the inverse as printed."""
    return P - P @ H.T @ np.linalg.inv(R + H @ P @ H.T @ C) @ C @ H @ P


def gain_12(full: bool = False) -> Outcome:
    """(12) is F times the gain of (6)."""
    worst = max(
        _relative(F @ P @ H.T @ C @ np.linalg.inv(R + H @ P @ H.T @ C), F @ _gain(H, P, R, C))
        for F, H, P, R, C in _systems(full=full)
    )
    return Outcome(worst, ALGEBRA, f"300 random systems, {'full' if full else 'diagonal'} R")


def covariance_14_own_gain() -> Outcome:
    """(14) as printed is (I - K H) P."""
    systems = _systems()
    worst = max(
        _relative(_printed_14(H, P, R, C), (np.eye(4) - _gain(H, P, R, C) @ H) @ P) for _, H, P, R, C in systems
    )
    return Outcome(
        worst, ALGEBRA, "300 random systems: S and C do not commute, C stands on the wrong side of the inverse"
    )


def covariance_14_navigation() -> Outcome:
    """(14) as printed is (I - K H) P on the paper's model, where S and C are diagonal."""
    worst = 0.0
    for c in np.random.default_rng(14).uniform(0.05, 1, (50, 2)):
        C, P = np.diag(c), np.kron([[2.1, 0.9], [0.9, 0.5]], np.eye(2))
        worst = max(worst, _relative(_printed_14(H, P, R, C), (np.eye(4) - _gain(H, P, R, C) @ H) @ P))
    return Outcome(worst, ALGEBRA, "the paper's model, 50 random C")


def covariance_14_from_6(identity: bool = False) -> Outcome:
    """The covariance of (16), (I - K H) P, is that of (6)."""
    worst = 0.0
    for _, H, P, R, C in _systems():
        K = _gain(H, P, R, np.eye(3) if identity else C)
        worst = max(worst, _relative((np.eye(4) - K @ H) @ P, _standard(K, H, P, R)))
    return Outcome(
        worst,
        ALGEBRA,
        f"300 random systems, {'C = I' if identity else 'C in (0.05, 1]: they differ by K (R C^-1 - R) K^T'}",
    )


def _one_sigma(full: bool = False) -> tuple[float, float]:
    """Asymmetry of P and Sig and smallest eigenvalue of P, relative, along 30 steps of (24) with random weights."""
    rng = np.random.default_rng(24)
    noise = np.array([[2.0, 0.9], [0.9, 1.0]]) if full else R
    P = Sig = np.kron([[2.1, 0.9], [0.9, 0.5]], np.eye(2)) + 0.1
    asymmetry, smallest = 0.0, inf
    for _ in range(30):
        C = np.diag(rng.uniform(0, 1, 2))
        G = C @ np.linalg.inv(noise + H @ P @ H.T @ C)
        L, lam = F @ P @ H.T @ G, Sig @ H.T @ G
        Sig, other = Sig @ (F - L @ H).T, F @ (Sig.T - P @ H.T @ lam.T)
        P = F @ P @ (F - L @ H).T + Q
        asymmetry = max(asymmetry, _relative(P, P.T), _relative(Sig.T, other))
        smallest = min(smallest, float(np.linalg.eigvalsh(0.5 * (P + P.T))[0] / np.trace(P)))
    return asymmetry, smallest


def two_forms_of_sigma(full: bool = False) -> Outcome:
    """The two forms of Sig in (24) are one matrix, and P is symmetric."""
    asymmetry, _ = _one_sigma(full)
    return Outcome(asymmetry, 1e-12, f"30 steps with random weights, {'full' if full else 'diagonal'} R")


def positive_definite() -> Outcome:
    """P of (24) is positive definite."""
    _, smallest = _one_sigma()
    return Outcome(
        max(0.0, -smallest), 0.0, f"30 steps with random weights; smallest eigenvalue {smallest:.1e} of the trace"
    )


@cache
def _measurements() -> Array:
    """60 steps of the navigation model with outliers in the measurement, one run."""
    rng = np.random.default_rng(5)
    x, y = np.array([1.0, 1, 0, 0]), np.empty((60, 2, 1))
    for k in range(60):
        x = F @ x + np.sqrt(0.109) * rng.standard_normal(4)
        y[k, :, 0] = H @ x + np.where(rng.random(2) < 0.2, np.sqrt(10), 0.1) * rng.standard_normal(2)
    return y


@cache
def _smoothed(sigma: float, at: int = 20, lag: int = 40, name: str = "fpmcs") -> Estimate:
    params = {"sigma": sigma} if name == "fpmcs" else {}
    smoother = filters.build(name, at=at, lag=lag, **params)
    x0, P0 = np.array([1.0, 1, 0, 0]), np.diag([4.0, 4, 3, 3])
    return smoother.run(Navigation(), _measurements(), x0, P0, Q=Q, R=R)


def infinite_width() -> Outcome:
    """sigma = inf is the fixed-point Kalman smoother."""
    a, b = _smoothed(inf), _smoothed(inf, name="ks")
    return Outcome(float(np.abs(a.mean - b.mean).max()), ALGEBRA, "60 steps, j = 20, lag 40")


def rate_of_convergence() -> Outcome:
    """The distance to the Kalman smoother falls by 100 for each factor of 10 in sigma."""
    limit = _smoothed(inf, name="ks").mean
    errors = [float(np.abs(_smoothed(sigma).mean - limit).max()) for sigma in (1e2, 1e3, 1e4)]
    ratios = [a / b for a, b in pairwise(errors)]
    return Outcome(max(abs(ratio - 100) for ratio in ratios), 3.0, f"ratios {ratios[0]:.3f}, {ratios[1]:.3f}")


def _gains(sigma: float, base: str = "prior_cov", lags: tuple[int, ...] = (0, 1, 2, 5, 20)) -> list[float]:
    """Smallest eigenvalue of P_j - Pi after each lag, relative to the trace of P_j."""
    estimate = _smoothed(sigma)
    P, Pi = estimate.extras[base][0, ..., 0], estimate.cov
    assert Pi is not None
    return [float(np.linalg.eigvalsh(P - Pi[t, ..., 0])[0] / np.trace(P)) for t in lags]


def strict_improvement() -> Outcome:
    """Pi_{k+1} < P_j strictly, for every k >= j."""
    smallest = _gains(3.0)
    return Outcome(
        float(sum(value <= 1e-12 for value in smallest)),
        0.0,
        "lags 0, 1, 2, 5, 20: after one measurement the gain has rank m < n",
    )


def strict_improvement_after(base: str = "prior_cov") -> Outcome:
    """Pi < P_j strictly once more measurements than n/m have come."""
    smallest = _gains(3.0, base, (2, 5, 20) if base == "prior_cov" else (5, 20, 40))
    return Outcome(
        float(sum(value <= 1e-12 for value in smallest)),
        0.0,
        f"smallest eigenvalues of the difference {min(smallest):.1e} of the trace",
    )


def strict_improvement_without_weight() -> Outcome:
    """Pi < P_j strictly where all weights have underflowed to 0: smallest eigenvalue of the difference."""
    smallest = _gains(1e-3)
    return Outcome(float(sum(value <= 0 for value in smallest)), 0.0, "sigma = 0.001, five lags: Pi stays P_j")


def growing_improvement() -> Outcome:
    """Pi_{k+1} <= Pi_k: most negative eigenvalue of Pi_k - Pi_{k+1}, relative to the trace."""
    worst = 0.0
    for sigma in (0.5, 1.0, 3.0, 10.0):
        Pi = _smoothed(sigma).cov
        assert Pi is not None
        steps = np.moveaxis(Pi[:-1, ..., 0] - Pi[1:, ..., 0], 0, 0)
        worst = max(worst, -float(np.linalg.eigvalsh(steps).min()) / float(np.trace(Pi[0, ..., 0])))
    return Outcome(max(worst, 0.0), 1e-12, "sigma = 0.5, 1, 3, 10; 40 lags")


def gain_depends_on_sigma() -> Outcome:
    """P_j - Pi changes with sigma: 0 where its traces differ by more than 1 %."""
    traces = [
        float(np.trace((e.extras["prior_cov"][0] - e.cov[-1])[..., 0]))
        for e in (_smoothed(s) for s in (1.0, 3.0, 10.0))
        if e.cov is not None
    ]
    spread = (max(traces) - min(traces)) / max(traces)
    return Outcome(float(spread < 0.01), 0.0, f"traces {', '.join(f'{t:.3f}' for t in traces)} for sigma = 1, 3, 10")


def kalman_gain() -> Outcome:
    """C = I has the improvement of the Kalman smoother."""
    a, b = _smoothed(inf), _smoothed(inf, name="ks")
    assert a.cov is not None
    assert b.cov is not None
    return Outcome(
        _relative(a.extras["prior_cov"][0] - a.cov[-1], b.extras["prior_cov"][0] - b.cov[-1]), ALGEBRA, "lag 40"
    )


def steady_gain_28() -> Outcome:
    """(28), with constant Sig and C, is (25) of the steady Kalman smoother, lags 0..10."""
    P = np.eye(4)
    for _ in range(400):
        P = F @ (P - P @ H.T @ np.linalg.solve(H @ P @ H.T + R, H @ P)) @ F.T + Q
    W = np.linalg.inv(H @ P @ H.T + R)
    A, Sig, true, worst = F - F @ P @ H.T @ W @ H, P, np.zeros((4, 4)), 0.0
    for t in range(11):
        true = true + Sig @ H.T @ W @ H @ Sig.T
        worst = max(worst, _relative((t + 1) * P @ H.T @ W @ H @ P, true))
        Sig = Sig @ A.T
    return Outcome(worst, ALGEBRA, "Sig is not constant: (28) has lost the index i; exact only at lag 0")


def series_3(ratios: tuple[float, ...] = (0.3, 0.7, 1.0, 1.5)) -> Outcome:
    """The partial sums of (3) reach the correntropy of Gaussian errors, (1 + s^2/sigma^2)^(-1/2): error after 400
    terms.
    """
    worst = 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        for ratio in ratios:
            n = np.arange(1, 400)
            terms = np.cumprod(np.append(1.0, -(2 * n - 1) / (2 * n) * ratio**2))
            worst = max(worst, abs(float(terms.sum()) - (1 + ratio**2) ** -0.5))
    return Outcome(worst, 1e-6, f"s/sigma = {', '.join(map(str, ratios))}; the series converges for s <= sigma only")


SMOOTHERS = {  # sums of a row of the printed Table 2 for smoother and filter, and the printed Table 3
    "KS": (1.6136 + 1.7879 + 1.0261 + 1.0742, 1.9482 + 2.0496 + 1.3474 + 1.3843, 38.15),
    "PS": (0.7415 + 1.3573 + 0.8319 + 0.8124, 1.0415 + 1.6232 + 1.1023 + 1.0572, 42.71),
    "sigma=0.5": (0.6818 + 1.2380 + 0.8127 + 0.7353, 0.8386 + 1.4327 + 1.0281 + 0.9602, 45.42),
    "sigma=1": (0.3649 + 0.9201 + 0.6447 + 0.6158, 0.5425 + 1.0795 + 0.8208 + 0.8558, 50.24),
    "sigma=3": (1.2217 + 1.5426 + 0.8719 + 0.8781, 1.5613 + 1.8302 + 1.1756 + 1.1914, 39.27),
    "sigma=5": (1.5824 + 1.7674 + 0.9816 + 1.0482, 1.8554 + 2.0299 + 1.2802 + 1.3593, 38.82),
    "sigma=10": (1.6379 + 1.7913 + 1.0225 + 1.0713, 1.9371 + 2.0772 + 1.3188 + 1.3912, 38.54),
}


def two_tables() -> Outcome:
    """100 (1 - sum of smoother MSE / sum of filter MSE) of the printed Table 2 is the printed Table 3: largest
    difference in points.
    """
    shown = {name: (100 * (1 - smoother / filt), printed) for name, (smoother, filt, printed) in SMOOTHERS.items()}
    text = ", ".join(f"{name} {ours:.1f} against {printed}" for name, (ours, printed) in shown.items())
    return Outcome(max(abs(ours - printed) for ours, printed in shown.values()), 1.0, text)


CHECKS: dict[str, Check] = {
    "C1": gain_12,
    "C1-full": lambda: gain_12(full=True),
    "C2-own-gain": covariance_14_own_gain,
    "C2-navigation": covariance_14_navigation,
    "C2-from-6": covariance_14_from_6,
    "C3-identity": lambda: covariance_14_from_6(identity=True),
    "C4-forms": two_forms_of_sigma,
    "C4-definite": positive_definite,
    "C4-full": lambda: two_forms_of_sigma(full=True),
    "C5": infinite_width,
    "C5-rate": rate_of_convergence,
    "C6": strict_improvement,
    "C6-later": strict_improvement_after,
    "C6-post": lambda: strict_improvement_after("post_cov"),
    "C6-no-weight": strict_improvement_without_weight,
    "C7": growing_improvement,
    "C9": gain_depends_on_sigma,
    "C9-identity": kalman_gain,
    "C10": steady_gain_28,
    "C46": two_tables,
    "C47": series_3,
    "C47-small": lambda: series_3((0.3, 0.7)),
    **fpmcs_counts.CHECKS,
}
