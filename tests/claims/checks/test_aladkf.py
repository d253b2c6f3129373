"""The exact checks of the ALADKF paper: what they measure is what they say, and they can fail."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.claims.checks import aladkf, checks_of

OUTCOMES = {id: check() for id, check in checks_of("aladkf-2020").items()}


@pytest.mark.parametrize("id", ["aladkf.T1", "aladkf.L1", "aladkf.C2a"])
def test_theorem_lemma_and_bounded_influence_hold(id):
    assert OUTCOMES[id].holds


def test_theorem_1_at_the_examples_of_the_note():  # check 13
    L = np.diag([4.0, 1.0])
    psi_inverse = np.diag([1.0, 256.0])
    assert np.linalg.cond(np.sqrt(psi_inverse)) == np.linalg.cond(L @ L) == 16
    assert np.linalg.cond(L @ psi_inverse @ L) == pytest.approx(16)
    assert np.linalg.cond(L @ np.diag([1.0, 15.0]) @ L) == pytest.approx(16 / 15)  # (46) is false here, and (47) too


def test_the_corrected_hessian_is_the_derivative_of_the_gradient_and_the_printed_one_is_not():  # check 12
    assert not OUTCOMES["aladkf.H1"].holds
    Sigma, A, z = aladkf._problem(6, 3)
    reference = aladkf._hessian_by_differences(Sigma, A, z)
    np.testing.assert_allclose(aladkf._hessian(Sigma, A, z, -1), reference, rtol=1e-6, atol=1e-9)
    halved = aladkf._hessian_by_differences(Sigma, A, 2 * z, 2e-3)  # residuals times 2: the Hessian is divided by 2
    np.testing.assert_allclose(2 * halved, reference, rtol=1e-6, atol=1e-9)


def test_a_convex_objective_has_no_indefinite_hessian():
    assert not OUTCOMES["aladkf.H2"].holds
    assert OUTCOMES["aladkf.H2"].deviation > -1e-9


def test_the_recursion_is_not_the_batch_matrix_and_that_matrix_is_singular_at_the_first_step():
    assert OUTCOMES["aladkf.H3"].deviation > 0.1
    assert OUTCOMES["aladkf.H5"].deviation == pytest.approx(0, abs=1e-12)


def test_every_exact_claim_of_the_paper_has_its_check():
    from rkfbench.scenario import load_paper

    named = {check for claim in load_paper("aladkf-2020").claims if claim.exact for check in claim.exact.checks}
    assert named == set(OUTCOMES)


def test_a_paper_without_checks_has_none():
    assert checks_of("nobody-1999") == {}
