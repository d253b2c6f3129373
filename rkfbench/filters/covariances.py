"""Whether the matrices that a filter is told are covariances.

P0 and Q must be positive semidefinite, R positive definite, as in a scenario: no filter gives a wrong answer silently.
Where each run has a matrix of its own, a run in which it is not finite has failed, as with a measurement that is not;
and what a singular R does to a run the filter finds out.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rkfbench.errors import SpecError
from rkfbench.linalg import Array, positive_definite

ROUNDING = 1e-9  # of the largest element: what products like B B' may miss
TINY = 1e-300  # makes a zero matrix positive definite


def check(name: str, A: Array, singular: bool) -> None:
    """SpecError unless A (d, d, M or 1) or (T, d, d, M or 1) is finite, symmetric and positive definite; with
    `singular` semidefinite is enough.
    """
    shared = A.shape[-1] == 1
    with np.errstate(all="ignore"):
        finite = np.isfinite(A).all(axis=(-3, -2))  # (M or 1) or (T, M or 1)
        size = np.abs(A).max(axis=(-3, -2))
        skew = np.abs(A - A.swapaxes(-3, -2)).max(axis=(-3, -2))
        if shared:
            _refuse(name, "finite", ~finite)
        _refuse(name, "symmetric", finite & (skew > ROUNDING * size))
        if shared:
            least = np.linalg.eigvalsh(A[..., 0])[..., :1]
            wrong = least < -ROUNDING * size if singular else least <= 0
        else:
            matrices = np.moveaxis(A, (-3, -2), (0, 1))
            lift = np.eye(A.shape[-2]).reshape(*A.shape[-3:-1], *(1,) * finite.ndim)
            wrong = finite & ~positive_definite(matrices + lift * (ROUNDING * size + TINY))
    _refuse(name, "positive semidefinite" if singular or not shared else "positive definite", wrong)


def _refuse(name: str, what: str, wrong: Any) -> None:
    """SpecError with the first of the matrices (M or 1) or (T, M or 1) that are wrong, if any is."""
    if not wrong.any():
        return
    *step, run = np.argwhere(wrong)[0].tolist()
    place = [f"at step {k + 1}" for k in step] + ([f"in run {run}"] if wrong.shape[-1] > 1 else [])
    raise SpecError(" ".join([f"{name} is not {what}", *place]))
