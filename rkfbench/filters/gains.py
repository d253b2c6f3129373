"""Gains first: the Kalman filter where all runs share the covariances.

On a linear model without robust weights neither covariances nor gains depend on what is measured, only on what is
missing. So the recursion of one run gives them all, and then a step of all runs is one small product:

    once for all runs   P- = F P F' + Q,  S = H P- H' + R,  K = P- H' S^-1,  P = P- - K H P-,  A = (I - K H) F
    of every run        x = A x + K y  (+ (I - K H) B u), which is x- + K (y - H x-) with x- = F x + B u

The first line is remembered by its input. As soon as a covariance returns to the last bit, which it does where the
filter has settled, nothing of it is computed any more: the same input gives the same bits.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate
from rkfbench.filters.recursion import Step
from rkfbench.linalg import Array, finite, positive_definite
from rkfbench.models import Linear, Model
from rkfbench.models.base import Smooth


class Gains(NamedTuple):
    """What the steps do to every run, time first: covariances before and after the update (T, n, n), S (T, m, m) and K
    (T, n, m). Where a component is missing, S is NaN and K is 0.
    """

    prior_P: Array
    S: Array
    K: Array
    P: Array


def shared(model: Model, y: Array, x: Array, P: Array, Q: Array, R: Array) -> bool:
    """Whether the covariances of these arguments, as `prepare` makes them, are the same for all runs at all steps."""
    missing = np.isnan(y)
    return bool(
        isinstance(model, Linear)
        and (type(model).f, type(model).h) == (Linear.f, Linear.h)  # F, H and the input are constant
        and type(model).residual is Smooth.residual
        and not model.angles
        and not hasattr(model, "plausible")
        and P.shape[-1] == Q.shape[-1] == R.shape[-1] == 1
        and (not missing.any() or (missing == missing[..., :1]).all())
    )


def run(model: Any, y: Array, x: Array, P: Array, Q: Array, R: Array, keep: Collection[str]) -> Estimate:
    """The estimates of the Kalman filter from arguments that are `shared`."""
    F, H, Bu = model.matrices
    with np.errstate(all="ignore"):
        gains = _gains(F, H, P, Q, R, ~np.isnan(y[..., 0]))
        mean = _means(F, H, Bu, y, x, gains)
        found = {"cov": gains.P[..., None], "prior_cov": gains.prior_P[..., None], "S": gains.S[..., None]}
        if {"prior_mean", "nu"} & {*keep}:
            found["prior_mean"] = F @ np.concatenate([x[None], mean[:-1]]) + (0.0 if Bu is None else Bu[:, None])
            found["nu"] = y - H @ found["prior_mean"]
    if missing := {*keep} - found.keys():
        raise SpecError(f"this filter has no history of {', '.join(sorted(missing))}")
    kept = {name: found[name] for name in keep}
    return Estimate(mean, kept.pop("cov", None), np.isnan(mean[-1]).any(0), kept)


def steps(model: Any, y: Array, x: Array, P: Array, Q: Array, R: Array) -> Iterator[Step]:
    """The same step after step, k = 1..T."""
    F, H, Bu = model.matrices
    gains = _gains(F, H, P, Q, R, ~np.isnan(y[..., 0]))
    means = _means(F, H, Bu, y, x, gains)
    for k, (yk, after, prior_P, S, _, P) in enumerate(zip(y, means, *gains, strict=True), 1):
        prior_x = model.f(x, k)
        seen = {"nu": yk - model.h(prior_x, k), "S": S[..., None]}
        x = after
        yield Step(prior_x, prior_P[..., None], x, P[..., None], seen)


def _means(F: Array, H: Array, Bu: Array | None, y: Array, x: Array, gains: Gains) -> Array:
    """x_k of every run (T, n, M); NaN from the step on at which a run has failed."""
    KH = gains.K @ H
    means = gains.K @ (np.where(np.isnan(y), 0.0, y) if np.isnan(y[..., 0]).any() else y)
    if Bu is not None:
        means += (Bu - KH @ Bu)[..., None]
    of_last = np.empty_like(x)
    for A, mean in zip(F - KH @ F, means, strict=True):
        mean += np.matmul(A, x, out=of_last)
        x = mean
    sound = positive_definite(np.moveaxis(gains.prior_P, 0, -1))
    if not (sound.all() and finite(means)):
        failed = ~(np.isfinite(means).all(1) & sound[:, None])
        means[np.broadcast_to(np.logical_or.accumulate(failed)[:, None], means.shape)] = np.nan
    return means


def _gains(F: Array, H: Array, P: Array, Q: Array, R: Array, observed: NDArray[np.bool_]) -> Gains:
    """The gains of all steps, at each of which the measurement components `observed` (T, m) are there."""
    known: dict[tuple[bytes, ...], tuple[Array, ...]] = {}
    found, P = [], P[..., 0]
    for k, rows in enumerate(observed):
        Qk, Rk = (A[k, ..., 0] if A.ndim == 4 else A[..., 0] for A in (Q, R))
        key = P.tobytes(), Qk.tobytes(), Rk.tobytes(), rows.tobytes()
        if key not in known:
            known[key] = _step(F, H, P, Qk, Rk, rows)
        found.append(known[key])
        P = found[-1][-1]
    prior_P, S, K, P = map(np.stack, zip(*found, strict=True))
    return Gains(_symmetric(prior_P), _symmetric(S), K, P)


def _step(F: Array, H: Array, P: Array, Q: Array, R: Array, rows: NDArray[np.bool_]) -> tuple[Array, ...]:
    """P-, S, K and P of one step, the first two symmetric but for rounding."""
    prior_P = F.dot(P).dot(F.T) + Q
    if rows.all():
        return prior_P, *_update(H, prior_P, R)
    there = np.ix_(rows, rows)
    S, K = np.full_like(R, np.nan), np.zeros(H.T.shape)
    S[there], K[:, rows], P = _update(H[rows], prior_P, R[there])
    return prior_P, S, K, P


def _update(H: Array, P: Array, R: Array) -> tuple[Array, Array, Array]:
    """S, K and the covariance after the update."""
    PH = P.dot(H.T)
    S = H.dot(PH) + R
    try:
        K = PH.dot(np.linalg.inv(S))
    except np.linalg.LinAlgError:  # no gain: all runs end here
        K = np.full_like(PH, np.nan)
    return S, K, _symmetric(P - K.dot(PH.T))


def _symmetric(A: Array) -> Array:
    """(A + A')/2 of matrices (n, n) or (T, n, n)."""
    return (A + A.swapaxes(-1, -2)) / 2
