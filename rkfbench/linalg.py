"""Linear algebra over the last axis: every array carries the Monte Carlo runs there, x (n, M), P (n, n, M), y (m, M).

An elementary operation is then one vector operation over all runs, and what all runs share keeps a last axis of length
1 and broadcasts. A matrix without a run axis (2-d) is shared as well and its products are single BLAS calls. Nothing
here raises for a bad run: a covariance that is not positive definite turns that run into NaN and leaves its neighbours
untouched.
"""

from __future__ import annotations

from functools import lru_cache
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]  # of floats, unless a docstring says otherwise

MANY = 40_000  # multiplications that pay for the calls which save half of them
EXP_700 = np.exp(np.full(1, -700.0))
SWEEPS = 6  # of Jacobi rotations: they reach the rounding level for n <= 6 (quadratic convergence)
NOTHING = 1e-17  # less than what addition notices, relative
LANES = 8  # runs that a vector instruction takes: BLAS rounds a batch of whole eights as it rounds any wider one


def mul(A: Array, B: Array) -> Array:
    """A B with A (i, j) shared or (i, j, M), and B (j, ...): the product over the first axis of B."""
    if A.ndim == 2:
        return A @ B if B.ndim == 2 else (A @ B.reshape(len(B), -1)).reshape(len(A), *B.shape[1:])
    if B.ndim == 2:
        return np.einsum("ij...,j...->i...", A, B)
    return np.einsum("ij...,jk...->ik...", A, B)


def transpose(A: Array) -> Array:
    """A' of every run."""
    return A.swapaxes(0, 1)


def sym(A: Array) -> Array:
    """(A + A')/2."""
    return 0.5 * (A + transpose(A))


def sandwich(A: Array, P: Array) -> Array:
    """A P A' for symmetric P, symmetric to the last bit. With a shared A it is one product: vec(A P A') = (A x A)
    vec(P).
    """
    if A.ndim > 2:
        return sym(mul(A, transpose(mul(A, P))))
    m, n = A.shape
    return (_twice(A.shape, content(A)) @ P.reshape(n * n, -1)).reshape(m, m, P.shape[-1])


def content(A: Array) -> bytes:
    """The numbers of an array, of integers too, as a key to what was computed from them: `np.frombuffer` gives them
    back.
    """
    return np.asarray(A, dtype=float).tobytes()


@lru_cache(maxsize=256)
def _twice(shape: tuple[int, int], content: bytes) -> Array:
    """The Kronecker product of A with itself, (m^2, n^2), with the rows of (i, j) and (j, i) made equal."""
    m, n = shape
    A = np.frombuffer(content).reshape(shape)
    K = np.kron(A, A).reshape(m, m, n * n)
    return (0.5 * (K + transpose(K))).reshape(m * m, n * n)


def finite(x: Array) -> bool:
    """Whether all numbers of all runs are finite; False also where one is so large that its square is not."""
    return isfinite(np.vdot(x, x))


def exp(x: Array) -> Array:
    """exp(x) - exp(-700) in the place of x, and 0 below -700: exp(x) to the last bit where that is above 1e-287, while
    NumPy takes five times as long for a number that underflows.
    """
    np.exp(np.maximum(x, -700.0, out=x), out=x)
    x -= EXP_700
    return x


def plus(A: Array, B: Array) -> Array:
    """A + B of every run, in the place of A where that is wide enough: for an A that nobody else holds."""
    return np.add(A, B, out=A) if A.shape[-1] >= B.shape[-1] else A + B


def gram(A: Array) -> Array:
    """A A' of every run for A (n, k, M), symmetric to the last bit."""
    n, k, M = A.shape
    if n * n * k * M < MANY:
        return np.einsum("ikM,jkM->ijM", A, A)
    G = np.empty((n, n, M))
    for i in range(n):  # half of it: calls cost less than what they save
        G[i, : i + 1] = G[: i + 1, i] = np.einsum("kM,jkM->jM", A[i], A[: i + 1])
    return G


def through(H: Array, P: Array) -> tuple[Array, Array]:
    """H P H' and P H' for symmetric P, of H (m, n) shared, in one product, or (m, n, M)."""
    m, n = H.shape[:2]
    if H.ndim == 2:
        both = (_joint(H.shape, content(H)) @ P.reshape(n * n, -1)).reshape(m, m + n, P.shape[-1])
        return both[:, :m], transpose(both[:, m:])
    HP = mul(H, P)
    S = np.empty((m, m, HP.shape[-1]))
    for i in range(m):
        S[i, : i + 1] = S[: i + 1, i] = np.einsum("kM,jkM->jM", HP[i], H[: i + 1])
    return S, transpose(HP)


@lru_cache(maxsize=256)
def _joint(shape: tuple[int, int], content: bytes) -> Array:
    """What makes the rows of [H P H' | H P] of vec(P), (m (m + n), n^2), with those of (i, j) and (j, i) made equal in
    the first part.
    """
    m, n = shape
    H = np.frombuffer(content).reshape(shape)
    products = np.kron(H, np.eye(n)).reshape(m, n, n * n)
    return np.concatenate([_twice(shape, content).reshape(m, m, n * n), products], 1).reshape(m * (m + n), n * n)


def outer(a: Array, b: Array) -> Array:
    """a b' of every run."""
    return a[:, None] * b[None]


def dot(a: Array, b: Array) -> Array:
    """a'b of every run."""
    return np.einsum("i...,i...->...", a, b)


def trace(A: Array) -> Array:
    """Sum of the diagonal of every run, (n, n, M) -> (M,)."""
    return np.asarray(A.reshape(-1, A.shape[-1])[:: len(A) + 1].sum(0))


def batched(A: Array) -> Array:
    """A with a run axis: a shared (i, j) becomes (i, j, 1)."""
    return A[..., None] if A.ndim == 2 else A


def eye(n: int) -> Array:
    """The identity, shared by all runs: (n, n, 1)."""
    return np.eye(n)[..., None]


def diag(d: Array) -> Array:
    """The diagonal matrix with diagonal d (n, M)."""
    D = np.zeros((len(d), *d.shape))
    for i, di in enumerate(d):
        D[i, i] = di
    return D


def add_diag(A: Array, d: Array) -> Array:
    """A (n, n, M) with d (n, M) added to its diagonal, in its own place."""
    for i, di in enumerate(d):
        A[i, i] += di
    return A


def cholesky(A: Array) -> Array:
    """Lower L with L L' = A (n, n, M); NaN in the runs where A is not positive definite."""
    L = np.zeros_like(A)
    for k in range(len(A)):
        c = A[k:, k] - np.einsum("ijM,jM->iM", L[k:, :k], L[k, :k]) if k else A[:, 0]
        np.multiply(c, 1 / np.sqrt(np.where(c[0] > 0, c[0], np.nan)), out=L[k:, k])
    return L


def positive_definite(A: Array) -> NDArray[np.bool_]:
    """Whether all pivots of A = L D L' are positive, by run: (n, n, M) -> (M,)."""
    good = A[0, 0] > 0
    while len(A) > 1:
        A = A[1:, 1:] - outer(A[1:, 0] / A[0, 0], A[0, 1:])
        good &= A[0, 0] > 0
    return good


def solve_lower(L: Array, B: Array) -> Array:
    """L^-1 B by forward substitution, L (m, m) shared or (m, m, M), B (m, ...)."""
    X = np.array(np.broadcast_to(B, B.shape[:-1] + np.broadcast_shapes(B.shape[-1:], L.shape[2:])))
    for i in range(len(L)):
        for j in range(i):
            X[i] -= L[i, j] * X[j]
        X[i] /= L[i, i]
    return X


def solve(S: Array, B: Array) -> Array:
    """S^-1 B by elimination without pivoting, for positive definite (or well scaled) S (m, m, M) and B (m, ..., M)."""
    if len(S) == 1:
        return B / S[0, 0]
    width = np.broadcast_shapes(B.shape[-1:], S.shape[2:])
    S, X = S.copy(), np.array(np.broadcast_to(B, B.shape[:-1] + width))
    for k in range(len(S)):
        for i in range(k + 1, len(S)):
            ratio = S[i, k] / S[k, k]
            S[i, k + 1 :] -= ratio * S[k, k + 1 :]
            X[i] -= ratio * X[k]
    for k in reversed(range(len(S))):
        for j in range(k + 1, len(S)):
            X[k] -= S[k, j] * X[j]
        X[k] /= S[k, k]
    return X


def condition(x: Array, P: Array, C: Array, S: Array, nu: Array) -> tuple[Array, Array]:
    """Gaussian conditioning x + C S^-1 nu and P - C S^-1 C', for cov(x, y) = C (n, m, M) and cov(y) = S (m, m, M).

    Elimination turns the rows of [S | C' | nu] into those of [L' | g' | e] with S = L L', g = C L'^-1, e = L^-1 nu;
    then the result is x + g e and P - g g'. No inverse, and P stays symmetric to the last bit. A pivot that is not
    positive makes the run NaN.
    """
    m, n = len(S), len(P)
    if S.shape[-1] == 1:  # one gain for all runs, so that those of nu are columns
        A = np.concatenate([S[..., 0], C[..., 0].T, nu], axis=1)
        _eliminate(A)
        g, e = A[:, m : m + n].T, A[:, m + n :]
        return x + g @ e, P - (g @ g.T)[..., None]
    A = np.empty((m, m + n + 1, S.shape[-1]))
    A[:, :m], A[:, m:-1], A[:, -1] = S, transpose(C), nu
    _eliminate(A)
    g, e = transpose(A[:, m:-1]), A[:, -1]
    less = gram(g)
    return x + np.einsum("ikM,kM->iM", g, e), np.subtract(P, less, out=less)


def _eliminate(A: Array) -> None:
    """Turn the rows of A = [S | B] with S = L L' into those of [L' | L^-1 B]; what is left of L' stays as it was.

    Where A is one matrix, row after row: a row times a matrix by BLAS rounds by the number of columns.
    """
    for k, row in enumerate(A):
        rest = row[k:]
        if A.ndim == 2:
            for above in A[:k]:
                rest -= above[k] * above[k:]
        elif k:
            rest -= np.einsum("jM,jiM->iM", A[:k, k], A[:k, k:])
        rest *= 1 / np.sqrt(rest[0])


def eigh(A: Array) -> tuple[Array, Array]:
    """Eigenvalues (n, M), ascending, and eigenvectors (n, n, M) as columns of symmetric A (n, n, M), by cyclic Jacobi
    rotations.
    """
    n = len(A)
    A, V = A.copy(), np.array(np.broadcast_to(eye(n), A.shape))
    for _ in range(SWEEPS if n > 2 else 1):
        for p in range(n - 1):
            for q in range(p + 1, n):
                c, s = _rotation(A[p, p], A[q, q], A[p, q])
                for B in (A, transpose(A), transpose(V)):
                    B[p], B[q] = c * B[p] - s * B[q], s * B[p] + c * B[q]
    w = np.stack([A[i, i] for i in range(n)])
    order = np.argsort(w, axis=0, kind="stable")
    return np.take_along_axis(w, order, 0), np.take_along_axis(V, order[None], 1)


def eigvalsh(A: Array) -> Array:
    """Eigenvalues (n, ...), ascending, of symmetric A (n, n, ...)."""
    return np.sort(_eigenvalues(A), axis=0)


def _eigenvalues(A: Array) -> Array:
    """Eigenvalues in no order: Jacobi rotations on the upper triangle alone."""
    n = len(A)
    a = {(i, j): A[i, j] for i in range(n) for j in range(i, n)}
    for _ in range(SWEEPS if n > 2 else 1):
        least = NOTHING * np.minimum.reduce([a[i, i] for i in range(n)])
        if all((np.abs(a[i, j]) <= least).all() for i, j in a if i != j):
            break  # a rotation would no longer change any eigenvalue
        for p in range(n - 1):
            for q in range(p + 1, n):
                c, s = _rotation(a[p, p], a[q, q], a[p, q])
                shift = (s / c) * a[p, q]
                a[p, p], a[q, q], a[p, q] = a[p, p] - shift, a[q, q] + shift, np.zeros_like(shift)
                for r in set(range(n)) - {p, q}:
                    rp, rq = (min(r, p), max(r, p)), (min(r, q), max(r, q))
                    a[rp], a[rq] = c * a[rp] - s * a[rq], s * a[rp] + c * a[rq]
    return np.stack([a[i, i] for i in range(n)])


def _rotation(app: Array, aqq: Array, apq: Array) -> tuple[Array, Array]:
    """Cosine and sine of the Jacobi rotation that annihilates a_pq (the smaller angle; the identity where a_pq = 0)."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        theta = 0.5 * (aqq - app) / apq
        t = np.where(apq == 0, 0.0, np.copysign(1.0, theta) / (np.abs(theta) + np.sqrt(theta * theta + 1.0)))
    c = 1.0 / np.sqrt(t * t + 1.0)
    return c, t * c


def cond(A: Array) -> Array:
    """Condition number in the 2-norm of symmetric positive definite A (n, n, ...): largest over smallest eigenvalue."""
    w = _eigenvalues(A)
    return w.max(0) / w.min(0)


def root(A: Array, kind: str = "symmetric") -> Array:
    """L with L L' = A: the symmetric square root or the lower Cholesky factor, of a shared (m, m) or of every run's
    (m, m, M).
    """
    if A.ndim == 3 and A.shape[2] > 1:
        if kind == "cholesky":
            return cholesky(A)
        w, V = eigh(A)
        return mul(V * np.sqrt(w), transpose(V))
    shared = A if A.ndim == 2 else A[..., 0]
    L = np.linalg.cholesky(shared) if kind == "cholesky" else _symmetric_root(shared)
    return L if A.ndim == 2 else L[..., None]


def _symmetric_root(A: Array) -> Array:
    w, V = np.linalg.eigh(A)
    return (V * np.sqrt(w)) @ V.T


@lru_cache(maxsize=256)
def _whitening(shape: tuple[int, ...], content: bytes, kind: str) -> tuple[Array, Array]:
    L = root(np.frombuffer(content).reshape(shape), kind)
    return L, np.linalg.inv(L)


def whitening(A: Array, kind: str = "symmetric", reuse: bool = True) -> tuple[Array, Array]:
    """L and L^-1 with L L' = A. For a shared A both are (m, m) and, with `reuse`, computed once and remembered; else
    both (m, m, M).
    """
    if A.ndim == 3 and A.shape[2] > 1:
        L = root(A, kind)
        return L, solve(L, np.broadcast_to(eye(len(A)), L.shape)) if kind == "symmetric" else solve_lower(
            L, eye(len(A))
        )
    shared = A if A.ndim == 2 else A[..., 0]
    compute = _whitening if reuse else _whitening.__wrapped__
    return compute(shared.shape, content(shared), kind)
