"""Gains first: the Kalman filter where all runs share the covariances.

On a linear model without robust weights neither covariances nor gains depend on what is measured, only on what is
missing. So the recursion of one run gives them all, and the means of all runs take three small products a step:

    once for all runs   P- = F P F' + Q,  S = H P- H' + R,  K = P- H' S^-1,  P = P- - K S K'
    of every run        x- = F x,  nu = y - H x-,  x = x- + K nu

The first line is remembered by its input. As soon as a covariance returns to the last bit, which it does where the
filter has settled, nothing of it is computed any more: the same input gives the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rkfbench.filters.recursion import Step
from rkfbench.linalg import Array, finite, positive_definite, sym
from rkfbench.models import Linear, Model


class Gain(NamedTuple):
    """What one step does to every run: covariances before and after it and S, each with a run axis of length 1, and K
    (n, m). Where a component is missing, S is NaN and K is 0.
    """

    prior_P: Array
    S: Array
    K: Array
    P: Array


def shared(model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> bool:
    """Whether the covariances of these arguments, as `prepare` makes them, are the same for all runs at all steps."""
    missing = np.isnan(y)
    return bool(
        isinstance(model, Linear)  # F and H are constant
        and not hasattr(model, "plausible")
        and P.shape[-1] == Q.shape[-1] == R.shape[-1] == 1
        and (missing == missing[..., :1]).all()
    )


def steps(model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> Iterator[Step]:
    """The steps k = 1..T of the Kalman filter, one after the other, from arguments that are `shared`."""
    observed = ~np.isnan(y[..., 0])
    complete = [bool(rows.all()) for rows in observed]
    gains = _gains(model.F(x, 1), model.H(x, 1), P, Q, R, observed)
    sound = positive_definite(np.concatenate([gain.prior_P for gain in gains], axis=-1)).tolist()
    for k, (yk, (prior_P, S, K, P)) in enumerate(zip(y, gains, strict=True), 1):
        prior_x = model.f(x, k)
        nu = model.residual(yk, model.h(prior_x, k))
        x = K @ (nu if complete[k - 1] else np.where(observed[k - 1, :, None], nu, 0.0))
        x += prior_x
        if not (sound[k - 1] and finite(x)):
            x = np.where(sound[k - 1] & np.isfinite(x).all(0), x, np.nan)
        yield Step(prior_x, prior_P, x, P, {"nu": nu, "S": S})


def _gains(F: Array, H: Array, P: Array, Q: Array, R: Array, observed: NDArray[np.bool_]) -> list[Gain]:
    """The gains of all steps, at each of which the measurement components `observed` (T, m) are there."""
    known: dict[tuple[bytes, ...], Gain] = {}
    found = []
    for k, rows in enumerate(observed):
        Qk, Rk = Q[k] if Q.ndim == 4 else Q, R[k] if R.ndim == 4 else R
        key = P.tobytes(), Qk.tobytes(), Rk.tobytes(), rows.tobytes()
        gain = known.get(key) or known.setdefault(key, _gain(F, H, P[..., 0], Qk[..., 0], Rk[..., 0], rows))
        found.append(gain)
        P = gain.P
    return found


def _gain(F: Array, H: Array, P: Array, Q: Array, R: Array, rows: NDArray[np.bool_]) -> Gain:
    """The gain of one step, from matrices without a run axis."""
    prior_P = sym(F @ P @ F.T) + Q
    if rows.all():
        S, K, P = _update(H, prior_P, R)
    else:
        there = np.ix_(rows, rows)
        S, K = np.full_like(R, np.nan), np.zeros_like(H.T)
        S[there], K[:, rows], P = _update(H[rows], prior_P, R[there])
    return Gain(prior_P[..., None], S[..., None], K, P[..., None])


def _update(H: Array, P: Array, R: Array) -> tuple[Array, Array, Array]:
    """S, K and the covariance after the update: with L L' = S and g = P H' L'^-1 they are g L^-1 and P - g g'."""
    PH = P @ H.T
    S = sym(H @ PH) + R
    try:
        inverse = np.linalg.inv(np.linalg.cholesky(S))
    except np.linalg.LinAlgError:  # no gain: all runs end here
        inverse = np.full_like(S, np.nan)
    g = PH @ inverse.T
    return S, g @ inverse, P - g @ g.T
