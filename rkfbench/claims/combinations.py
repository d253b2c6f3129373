"""Combinations of several statistics that are more than arithmetic: sums of shares term by term, eigenvalues."""

from __future__ import annotations

from itertools import product
from math import isqrt

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def share_terms(coefficients: Array, flags: Array) -> tuple[tuple[float, int], ...]:
    """A sum of shares as terms (v, number of runs) with sum v number/runs its value; flags (k, M) are 0 or 1.

    The values v that the sum takes in single runs, where they are no more than the shares (of a - b: 1 and -1), so
    that runs in which both are flagged cancel; else the shares themselves with their coefficients.
    """
    k = len(coefficients)
    patterns = np.array(list(product((0.0, 1.0), repeat=k))).T if k <= 3 else np.zeros((k, 0))
    possible = [float(v) for v in np.unique(np.round(coefficients @ patterns, 12)) if v]
    if 0 < len(possible) <= k:
        values = np.round(coefficients @ flags, 12)
        return tuple((v, int((values == v).sum())) for v in possible)
    return tuple((float(c), int(each.sum())) for c, each in zip(coefficients, flags, strict=True))


def least_eigenvalue(parts: list[Array]) -> Array:
    """The least eigenvalue (size,) of symmetric matrices, from the lower triangle row by row, (size,) each."""
    matrix = _symmetric(parts)
    if not np.isfinite(matrix).all():
        return np.full(parts[0].size, np.nan)
    return np.asarray(np.linalg.eigvalsh(matrix)[:, 0])


def along_least(parts: list[Array], chosen: list[Array]) -> Array:
    """u'Au (size,) for matrices A by their lower triangle, u the eigenvector of the least eigenvalue of `chosen`."""
    (matrix,) = _symmetric(chosen)
    if not np.isfinite(matrix).all():
        return np.full(parts[0].size, np.nan)
    u = np.linalg.eigh(matrix).eigenvectors[:, 0]
    return np.asarray(np.einsum("i,aij,j->a", u, _symmetric(parts), u))


def _symmetric(parts: list[Array]) -> Array:
    """(size, n, n)"""
    n = triangle(len(parts))
    rows, columns = np.tril_indices(n)
    matrix = np.full((parts[0].size, n, n), np.nan)
    matrix[:, rows, columns] = matrix[:, columns, rows] = np.array(parts).T
    return matrix


def triangle(count: int) -> int:
    """n such that n (n + 1)/2 is the count; 0 if there is none."""
    n = (isqrt(8 * count + 1) - 1) // 2
    return n if n * (n + 1) // 2 == count else 0
