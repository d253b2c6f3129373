"""Matrices as a scenario writes them: a number, a diagonal, rows, or an operation on another matrix.

`2` is 2 I; `[25, 1]` a diagonal; `[[1, .5], [.5, 1]]` the rows; `{matrix_root_of: M}` the symmetric square root;
`{elementwise_root_of: M}`; `{cholesky_of: M}` the lower factor L with L L' = M; `{transposed_cholesky_of: M}` L';
`{times: 100, of: M}` a multiple, where inside `outliers` M may be the word `body`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rkfbench.errors import SpecError, did_you_mean, under
from rkfbench.linalg import Array

LARGEST = 1e150  # of an element: squares and their sums stay finite


def symmetric_root(C: Array) -> Array:
    """C^(1/2) of a positive semidefinite C; an eigenvalue that rounding took below 0 is 0."""
    w, V = np.linalg.eigh(C)
    return (V * np.sqrt(np.maximum(w, 0))) @ V.T


def _elementwise_root(M: Array) -> Array:
    if (M < 0).any():
        raise SpecError("an elementwise root needs elements that are not negative")
    return np.sqrt(M)


def _cholesky(M: Array) -> Array:
    try:
        return np.linalg.cholesky(_covariance(M))
    except np.linalg.LinAlgError:
        raise SpecError("a Cholesky factor needs a positive definite matrix") from None


OPERATIONS: dict[str, Callable[[Array], Array]] = {
    "matrix_root_of": lambda M: symmetric_root(_covariance(M)),
    "elementwise_root_of": _elementwise_root,
    "cholesky_of": _cholesky,
    "transposed_cholesky_of": lambda M: _cholesky(M).T,
}


def matrix(spec: Any, dim: int, names: Mapping[str, Array] | None = None) -> Array:
    """The (dim, dim) matrix that `spec` describes; `names` are matrices that may be called by name. SpecError with the
    path of a fault.
    """
    if isinstance(spec, str):
        if names and spec in names:
            return names[spec]
        known = ", ".join(names) if names else "none here"
        raise SpecError(f"'{spec}' names no matrix{did_you_mean(spec, names or ())} (known: {known})")
    if isinstance(spec, Mapping):
        return _operation(spec, dim, names)
    try:
        M = np.array(spec, dtype=float)
    except (TypeError, ValueError):
        raise SpecError(
            "should be a number, a list (diagonal), rows of equal length or an operation on a matrix"
        ) from None
    M = _finite(M)
    if M.ndim == 0:
        return M * np.eye(dim)
    if M.shape == (dim,):
        return np.diag(M)
    if M.shape == (dim, dim):
        return M
    raise SpecError(
        f"has shape {' x '.join(map(str, M.shape))}, expected {dim} x {dim} (or a number, or {dim} diagonal elements)"
    )


def _finite(M: Array) -> Array:
    if not (np.abs(M) <= LARGEST).all():
        raise SpecError(f"a matrix must have finite elements, none beyond {LARGEST:g}")
    return M


def _operation(spec: Mapping[str, Any], dim: int, names: Mapping[str, Array] | None) -> Array:
    if set(spec) == {"times", "of"}:
        factor = spec["times"]
        if isinstance(factor, bool) or not isinstance(factor, int | float):
            raise SpecError("should be a number", ["times"])
        with np.errstate(all="ignore"):
            with under("of"):
                M = matrix(spec["of"], dim, names)
            return _finite(factor * M)
    if len(spec) == 1 and (name := next(iter(spec))) in OPERATIONS:
        with under(name):
            return OPERATIONS[name](matrix(spec[name], dim, names))
    known = [*OPERATIONS, "times with of"]
    wrong = next((key for key in spec if key not in OPERATIONS and key not in ("times", "of")), None)
    if wrong is not None:
        raise SpecError(
            f"unknown matrix operation{did_you_mean(wrong, OPERATIONS)} (known: {', '.join(known)})", [wrong]
        )
    raise SpecError(f"one matrix operation is expected here (known: {', '.join(known)})")


def covariance(spec: Any, dim: int, names: Mapping[str, Array] | None = None) -> Array:
    """The symmetric positive semidefinite (dim, dim) matrix that `spec` describes."""
    return _covariance(matrix(spec, dim, names))


def _covariance(M: Array) -> Array:
    if not np.allclose(M, M.T, rtol=1e-12, atol=1e-12 * np.abs(M).max(initial=0)):
        raise SpecError("a covariance must be symmetric")
    M = 0.5 * M + 0.5 * M.T
    smallest = np.linalg.eigvalsh(M)[0]
    if smallest < -1e-12 * max(1.0, np.abs(M).max()):
        raise SpecError(f"a covariance must not be indefinite (smallest eigenvalue {smallest:.6g})")
    return M


def factor(C: Array) -> Array:
    """Some L with L L' = C for a positive semidefinite C: the lower Cholesky factor where there is one, else the
    symmetric root.
    """
    try:
        return np.linalg.cholesky(C)
    except np.linalg.LinAlgError:
        return symmetric_root(_covariance(C))
