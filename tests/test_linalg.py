"""The batch-last operations against NumPy, run by run."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench import linalg

RNG = np.random.default_rng(11)


def batch(n, M):
    A = RNG.standard_normal((n, n, M))
    return np.einsum("ikm,jkm->ijm", A, A) + 0.3 * np.eye(n)[..., None]


@pytest.mark.parametrize("M", [1, 7])
def test_condition_is_gaussian_conditioning_and_keeps_P_symmetric_to_the_last_bit(M):
    joint = batch(7, M)
    P, C, S = joint[:4, :4], joint[:4, 4:], joint[4:, 4:]
    x, nu = RNG.standard_normal((4, 7)), RNG.standard_normal((3, 7))
    x1, P1 = linalg.condition(x, P, C, S, nu)
    for i in range(7):
        j = i if M > 1 else 0
        K = C[..., j] @ np.linalg.inv(S[..., j])
        np.testing.assert_allclose(x1[:, i], x[:, i] + K @ nu[:, i], rtol=1e-11)
        np.testing.assert_allclose(P1[..., j], P[..., j] - K @ C[..., j].T, rtol=1e-10, atol=1e-12)
    assert np.array_equal(P1, linalg.transpose(P1))


def test_condition_widens_what_is_shared_when_S_belongs_to_each_run():
    P, C, S = batch(4, 1), RNG.standard_normal((4, 3, 1)), batch(3, 6)
    x1, P1 = linalg.condition(np.zeros((4, 6)), P, C, S, np.ones((3, 6)))
    assert x1.shape == (4, 6) and P1.shape == (4, 4, 6)


def test_a_run_with_an_indefinite_S_becomes_nan_and_leaves_its_neighbours_untouched():
    P, C, S = batch(4, 3), RNG.standard_normal((4, 3, 3)), batch(3, 3)
    x, nu = RNG.standard_normal((4, 3)), RNG.standard_normal((3, 3))
    before = linalg.condition(x, P, C, S, nu)
    S[..., 1] = np.diag([1.0, -1.0, 1.0])
    with np.errstate(invalid="ignore"):
        after = linalg.condition(x, P, C, S, nu)
    assert np.isnan(after[0][:, 1]).all()
    for a, b in zip(before, after, strict=True):
        assert np.array_equal(a[..., [0, 2]], b[..., [0, 2]])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 6])
def test_eigenvalues_vectors_condition_number_and_roots_equal_numpys(n):
    A = batch(n, 5)
    w, V = linalg.eigh(A)
    L = linalg.root(A)
    for i in range(5):
        np.testing.assert_allclose(w[:, i], np.linalg.eigvalsh(A[..., i]), rtol=1e-12)
        np.testing.assert_allclose((V[..., i] * w[:, i]) @ V[..., i].T, A[..., i], atol=1e-12)
        np.testing.assert_allclose(L[..., i] @ L[..., i], A[..., i], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(linalg.cond(A)[i], np.linalg.cond(A[..., i]), rtol=1e-10)
    np.testing.assert_allclose(linalg.eigvalsh(A), w, rtol=1e-13)


def test_condition_numbers_stay_exact_when_they_are_huge():
    Q, _ = np.linalg.qr(RNG.standard_normal((3, 3)))
    A = (Q * np.array([1e6, 1.0, 1e-3])) @ Q.T
    np.testing.assert_allclose(linalg.cond(A[..., None]), 1e9, rtol=1e-5)


def test_cholesky_and_definiteness_agree_run_by_run():
    A = batch(4, 4)
    A[..., 2] = np.diag([1.0, 1.0, -1e-3, 1.0])
    A[..., 3] = np.nan
    with np.errstate(invalid="ignore"):
        L, good = linalg.cholesky(A), linalg.positive_definite(A)
    assert good.tolist() == [True, True, False, False]
    assert np.isnan(L[..., 2]).any()
    np.testing.assert_allclose(L[..., 0], np.linalg.cholesky(A[..., 0]), rtol=1e-12)
    assert linalg.positive_definite(A[..., :1]).tolist() == [True]
    assert linalg.positive_definite(A[..., 2:3]).tolist() == [False]


@pytest.mark.parametrize("kind", ["symmetric", "cholesky"])
@pytest.mark.parametrize("M", [None, 1, 4])
def test_whitening_gives_a_root_and_its_inverse(kind, M):
    A = batch(3, 4)[..., 0] if M is None else batch(3, M)
    L, inverse = linalg.whitening(A, kind)
    LL, I = linalg.mul(L, linalg.transpose(L)), linalg.mul(inverse, L)  # noqa: E741
    full = A[..., 0] if M == 1 else A
    np.testing.assert_allclose(LL, full, atol=1e-12)
    np.testing.assert_allclose(I, np.broadcast_to(np.eye(3) if I.ndim == 2 else linalg.eye(3), I.shape), atol=1e-10)


def test_solve_and_triangular_solve_equal_numpys():
    S, b = batch(3, 4), RNG.standard_normal((3, 2, 4))
    L = linalg.cholesky(S)
    for i in range(4):
        np.testing.assert_allclose(linalg.solve(S, b)[..., i], np.linalg.solve(S[..., i], b[..., i]), rtol=1e-9)
        np.testing.assert_allclose(linalg.solve_lower(L, b)[..., i], np.linalg.solve(L[..., i], b[..., i]), rtol=1e-9)


def test_products_with_shared_and_own_matrices_equal_numpys():
    A, B = RNG.standard_normal((3, 4)), RNG.standard_normal((4, 2, 5))
    own = RNG.standard_normal((3, 4, 5))
    for i in range(5):
        np.testing.assert_allclose(linalg.mul(A, B)[..., i], A @ B[..., i])
        np.testing.assert_allclose(linalg.mul(own, B)[..., i], own[..., i] @ B[..., i])
        np.testing.assert_allclose(linalg.mul(own, B[:, 0])[..., i], own[..., i] @ B[:, 0, i])


@pytest.mark.parametrize("M", [1, 6])
def test_a_sandwich_is_symmetric_to_the_last_bit(M):
    P = batch(4, M)
    for A in (RNG.standard_normal((3, 4)), RNG.standard_normal((4, 4)), RNG.standard_normal((3, 4, M))):
        B = linalg.sandwich(A, P)
        assert np.array_equal(B, linalg.transpose(B))
        for i in range(M):
            own = A if A.ndim == 2 else A[..., i]
            np.testing.assert_allclose(B[..., i], own @ P[..., i] @ own.T, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("M", [2, 9, 3000])
def test_half_of_a_symmetric_product_gives_the_bits_of_the_whole(M, monkeypatch):
    A = RNG.standard_normal((5, 4, M))
    whole = np.einsum("ikM,jkM->ijM", A, A)
    for many in (0, np.inf):
        monkeypatch.setattr(linalg, "MANY", many)
        assert np.array_equal(linalg.gram(A), whole)


@pytest.mark.parametrize("H", [RNG.standard_normal((3, 4)), RNG.standard_normal((3, 4, 6))])
def test_through_is_H_P_H_and_P_H(H):
    P = batch(4, 6)
    S, C = linalg.through(H, P)
    each = linalg.batched(H) + np.zeros(6)
    np.testing.assert_allclose(S, np.einsum("aim,ijm,bjm->abm", each, P, each), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(C, np.einsum("ijm,bjm->ibm", P, each), rtol=1e-12, atol=1e-12)
    assert np.array_equal(S, linalg.transpose(S))


def test_finite_tells_numbers_from_what_is_none():
    assert linalg.finite(np.full((2, 3), 1e100))
    assert not any(linalg.finite(np.array([[1.0, bad]])) for bad in (np.nan, np.inf, -np.inf))


def test_exp_is_exp_but_for_what_underflows():
    x = np.array([0.0, -1.0, -660.0, -700.5, -np.inf, np.nan, 3.0] * 5)
    assert np.array_equal(linalg.exp(x.copy()), np.where(x < -700, 0.0, np.exp(x)), equal_nan=True)


def test_eigenvalues_do_not_depend_on_the_neighbours_of_a_run():
    A = batch(4, 50)
    A[..., 0] = np.diag([1.0, 2.0, 3.0, 4.0])  # needs no sweep at all
    together = linalg.eigvalsh(A)
    for i in (0, 7):
        assert np.array_equal(linalg.eigvalsh(A[..., i : i + 1])[:, 0], together[:, i])
    np.testing.assert_allclose(together, np.linalg.eigvalsh(np.moveaxis(A, -1, 0)).T, rtol=1e-12)


@pytest.mark.parametrize("shape", [(4, 4), (1, 4), (3, 4), (36, 36), (4, 300)])
def test_a_product_of_whole_eights_of_runs_is_rounded_as_a_wider_one(shape):
    """Cases side by side, and any number of runs, rest on this; BLAS rounds runs beyond whole eights otherwise."""
    A, B = RNG.standard_normal(shape), RNG.standard_normal((shape[1], 4096))
    whole = linalg.mul(A, B)
    for width in (1, 5, 13, 52, 125):
        for first in (0, linalg.LANES, 37):
            runs = slice(first, first + width * linalg.LANES)
            assert linalg.mul(A, np.ascontiguousarray(B[:, runs])).tobytes() == whole[:, runs].tobytes()


def test_integers_are_numbers():
    A, P = np.array([[1, 1], [0, 1]]), np.arange(12.0).reshape(2, 2, 3) + 10 * np.eye(2)[..., None]
    P = linalg.sym(P)
    np.testing.assert_array_equal(linalg.sandwich(A, P), linalg.sandwich(A.astype(float), P))
    for ours, expected in zip(linalg.through(A, P), linalg.through(A.astype(float), P), strict=True):
        np.testing.assert_array_equal(ours, expected)
    R = np.array([[4, 1], [1, 3]])
    for ours, expected in zip(linalg.whitening(R), linalg.whitening(R.astype(np.float32)), strict=True):
        np.testing.assert_array_equal(ours, expected)
