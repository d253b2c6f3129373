"""Exact checks of the PEKF paper: the linear theory (23), (25), (26), (31) against partial differential equation (10)
and the Kalman update, and what (37)-(38) converge to as dl -> 0.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from rkfbench.claims.checks import Check, Outcome
from rkfbench.filters import build
from rkfbench.filters.base import Posterior
from rkfbench.linalg import Array
from rkfbench.models import Model
from rkfbench.models.base import Linear
from rkfbench.models.range_bearing import RangeBearing
from rkfbench.models.ungm import UNGM

N, M = 4, 3  # dimensions of the random linear systems
SYSTEMS = 20


def _system(rng: np.random.Generator) -> tuple[Array, Array, Array, Array, Array]:
    """Random full x0, P0, H, R, y."""

    def covariance(n: int) -> Array:
        A = rng.standard_normal((n, n))
        return A @ A.T + 0.2 * np.eye(n)

    return rng.standard_normal(N), covariance(N), rng.standard_normal((M, N)), covariance(M), rng.standard_normal(M)


def _at(lam: float, x0: Array, P0: Array, H: Array, R: Array, y: Array) -> tuple[Array, Array]:
    """Mean and covariance of the homotopy (1) for a linear Gaussian model: the update with R/lam."""
    P = np.linalg.inv(np.linalg.inv(P0) + lam * H.T @ np.linalg.solve(R, H))
    return x0 + lam * P @ H.T @ np.linalg.solve(R, y - H @ x0), P


def _integrated(right_side: Callable[[float, Array], Array], start: Array) -> Array:
    from scipy.integrate import solve_ivp

    return np.asarray(solve_ivp(right_side, (0.0, 1.0), start, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1])


def _largest(pairs: list[tuple[Array, Array]]) -> float:
    return max(float(np.abs(a - b).max() / max(1.0, np.abs(b).max())) for a, b in pairs)


def exact_solution() -> Outcome:
    """Particles that move with (23) from the prior end with the moments of the Kalman update.

    (23) is affine, dx/dlam = A x + b: its flow Phi takes the prior mean m and covariance P0 to Phi m + c and Phi P0
    Phi'.
    """
    rng, pairs = np.random.default_rng(23), []
    for _ in range(5):
        x0, P0, H, R, y = system = _system(rng)

        def move(lam: float, state: Array) -> Array:
            x, P = _at(lam, *system)  # noqa: B023
            G = P @ H.T @ np.linalg.inv(R)  # noqa: B023
            points = state.reshape(N + 1, N)  # rows: the mean, then the images of the axes
            drift = (G @ (y - 0.5 * H @ x))[None]  # noqa: B023
            return np.concatenate([points[:1] @ (-0.5 * G @ H).T + drift, points[1:] @ (-0.5 * G @ H).T]).ravel()  # noqa: B023

        end = _integrated(move, np.vstack([x0, np.eye(N)]).ravel()).reshape(N + 1, N)
        x, P = _at(1.0, *system)
        pairs += [(end[0], x), (end[1:].T @ P0 @ end[1:], P)]
    return Outcome(_largest(pairs), 1e-8, "moments of the particles against the Kalman update, relative")


def kalman_bucy() -> Outcome:
    """The moments of (26) have the right sides of (25), and so the solution of (25) over unit time with constant y."""
    rng, pairs = np.random.default_rng(31), []
    for i in range(SYSTEMS):
        x0, P0, H, R, y = system = _system(rng)
        K = P0 @ H.T @ np.linalg.inv(R)
        A = -0.5 * K @ H
        pairs += [(A @ x0 + K @ (y - 0.5 * H @ x0), K @ (y - H @ x0)), (A @ P0 + P0 @ A.T, -K @ R @ K.T)]
        if i < 3:

            def right_side(_: float, state: Array) -> Array:
                x, P = state[:N], state[N:].reshape(N, N)
                K = P @ H.T @ np.linalg.inv(R)  # noqa: B023
                return np.concatenate([K @ (y - H @ x), (-K @ R @ K.T).ravel()])  # noqa: B023

            end = _integrated(right_side, np.concatenate([x0, P0.ravel()]))
            x, P = _at(1.0, *system)
            pairs += [(end[:N], x), (end[N:].reshape(N, N), P)]
    return Outcome(_largest(pairs), 1e-8, "right sides and solutions of (25) and (31), relative")


def _residual(
    x: Array,
    mean: Array,
    P: Array,
    y: Array,
    R: Array,
    h: Callable[[Array], Array],
    jac: Callable[[Array], Array],
    expected: float,
) -> tuple[float, float]:
    """Left side of (10) over q, and what is left of the equation, for f of (23) or (32)-(34) and q = N(mean, P)."""
    G = P @ jac(mean).T @ np.linalg.inv(R)
    f = G @ (y - 0.5 * (h(x) + h(mean)))
    divergence = -0.5 * np.trace(G @ jac(x))
    left = -0.5 * (y - h(x)) @ np.linalg.solve(R, y - h(x)) - expected
    return float(left), float(left + divergence - (x - mean) @ np.linalg.solve(P, f))


def differential_equation() -> Outcome:
    """(23) leaves nothing of (10) at random x and lam, for random linear Gaussian systems."""
    rng, worst = np.random.default_rng(10), 0.0
    for _ in range(SYSTEMS):
        _, _, H, R, y = system = _system(rng)
        mean, P = _at(rng.random(), *system)
        nu = y - H @ mean
        expected = -0.5 * (nu @ np.linalg.solve(R, nu) + np.trace(np.linalg.solve(R, H @ P @ H.T)))
        for _ in range(5):
            x = mean + np.linalg.cholesky(P) @ rng.standard_normal(N)
            left, rest = _residual(x, mean, P, y, R, lambda s: H @ s, lambda s: H, expected)  # noqa: B023
            worst = max(worst, abs(rest) / max(1.0, abs(left)))
    return Outcome(worst, 1e-9, "what is left of (10), relative to its left side")


def nonlinear_equation(model: Model, mean: Array, P: Array, y: Array, R: Array) -> Outcome:
    """What (34) leaves of (10) at lam = 0, over the left side: root mean squares over q = N(mean, P)."""

    def h(x: Array) -> Array:
        return model.h(x, 1)

    rng = np.random.default_rng(34)
    points = mean[:, None] + np.linalg.cholesky(P) @ rng.standard_normal((len(mean), 4000))
    nu = y[:, None] - model.h(points, 1)
    expected = float(-0.5 * (nu * np.linalg.solve(R, nu)).sum(0).mean())
    sides = [_residual(x, mean, P, y, R, h, lambda s: model.H(s, 1), expected) for x in points.T[:1000]]
    left, rest = np.sqrt((np.array(sides) ** 2).mean(0))
    return Outcome(float(rest / left), 1.0, "root mean square of what is left of (10), over that of its left side")


def _growth(q2: float) -> Outcome:
    """The growth model: prior mean 8, variance q^2, a measurement one standard deviation off."""
    return nonlinear_equation(
        UNGM(), np.array([8.0]), np.array([[q2]]), np.array([(8 + q2**0.5) ** 2 / 20]), np.array([[0.01]])
    )


def _far_prior() -> Outcome:
    """Range and bearing as in 5.1, at the first step."""
    truth = np.array([100.0, 100.0])
    return nonlinear_equation(
        RangeBearing(), np.array([20.0, 80.0]), 100 * np.eye(2), RangeBearing().h(truth, 1), np.diag([2.5e-5, 6e-3])
    )


class _Direct(Linear):
    """One state, measured as it is."""

    states, measurements = ("x",), ("y",)
    matrices = np.eye(1), np.eye(1), None


# x, P, y, R: a prior far off and a precise range, in the geometry of 5.1
SET_UP = np.array([20.0, 80.0]), 100 * np.eye(2), np.array([120.0, 0.9]), np.diag([1.0, 6e-3])


def _update(scheme: str, model: Model, x: Array, P: Array, y: Array, R: Array, **params: object) -> Posterior:
    filt = build({"moments": "taylor", "update": {scheme: params} if params else scheme})
    return filt.correct(model, x[:, None], P[..., None], y[:, None], 1, R[..., None])  # type: ignore[attr-defined]


def one_step_is_the_ekf() -> Outcome:
    """dl = 1 is the EKF bit for bit, for random priors in 5.1's model."""
    rng, worst = np.random.default_rng(1), 0.0
    for _ in range(SYSTEMS):
        x, y = rng.uniform(-100, 100, 2), np.array([rng.uniform(10, 150), rng.uniform(-3, 3)])
        A = rng.standard_normal((2, 2))
        told = RangeBearing(), x, 50 * A @ A.T + np.eye(2), y, np.array([[0.1, 0.001], [0.001, 0.006]])
        one, ekf = _update("progressive", *told, dl=1.0), _update("once", *told)
        worst = max(worst, float(np.abs(one.x - ekf.x).max()), float(np.abs(one.P - ekf.P).max()))
    return Outcome(worst, 0.0, "largest difference from the EKF in mean and covariance")


def distance(scheme: str, saturated: bool) -> Outcome:
    """Distance in mean between sub-steps of dl = 0.001 and the flow, over the distance that the flow itself moves the
    mean.
    """
    told = RangeBearing(), *SET_UP
    flow = _update("flow", *told, saturated=saturated).x
    steps = [_update(scheme, *told, dl=dl).x for dl in (0.1, 0.01, 1e-3)]
    apart = [float(np.abs(x - flow).max() / np.abs(flow[:, 0] - SET_UP[0]).max()) for x in steps]
    words = ", ".join(f"{each:.2g}" for each in apart)
    return Outcome(apart[-1], 0.01, f"distance over the flow's own way for dl = 0.1, 0.01, 0.001: {words}")


def scalar_distance(rho: float) -> Outcome:
    """What dl = 0.001 leaves of the prior variance, against 1/(1 + rho) of (35), for one state measured directly with
    P/R = rho.
    """
    one = np.ones((1, 1))
    left = _update("progressive", _Direct(), np.zeros(1), one, np.ones(1), one / rho, dl=1e-3).P[0, 0, 0]
    return Outcome(float(left * (1 + rho) - 1), 0.01, f"left of the variance: {left:.6f}; of (35): {1 / (1 + rho):.6f}")


def work() -> Outcome:
    """Ten sub-steps times ten, over the right sides that the stiff solver takes for (35)."""
    seen = _update("flow", RangeBearing(), *SET_UP).seen
    evaluations = float(seen["evaluations"][0, 0])
    return Outcome(100 / evaluations, 1.0, f"{evaluations:.0f} right sides for 10 sub-steps")


CHECKS: dict[str, Check] = {
    "3-a": exact_solution,
    "3-b": kalman_bucy,
    "3-c": differential_equation,
    "4-a": one_step_is_the_ekf,
    "4-b": partial(distance, "progressive", saturated=False),
    "4-b-scalar-1": partial(scalar_distance, 1.0),
    "4-b-scalar-10": partial(scalar_distance, 10.0),
    "4-b-tempered": partial(distance, "tempered", saturated=False),
    "4-b-saturated": partial(distance, "progressive", saturated=True),
    "4-c": work,
    "4-d-range-bearing": _far_prior,
    "4-d-ungm-1": partial(_growth, 1.0),
    "4-d-ungm-100": partial(_growth, 100.0),
}
