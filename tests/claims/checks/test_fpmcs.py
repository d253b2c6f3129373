"""The exact checks of the FP-MCS paper: which of its statements hold, and counts in a form of their own."""

from __future__ import annotations

import pytest

from rkfbench.claims.checks.fpmcs import CHECKS
from rkfbench.claims.checks.fpmcs_counts import ROWS, sum_30, sum_31, sums, total_29, total_30, total_31

HOLDS = {
    *("C1", "C1-full", "C2-navigation", "C3-identity", "C4-forms", "C4-definite", "C5", "C5-rate", "C6-later"),
    *("C6-post", "C7", "C9", "C9-identity", "C11", "C15", "C47-small"),
}


@pytest.mark.parametrize("id", CHECKS)
def test_what_holds_and_what_does_not(id):
    assert CHECKS[id]().holds == (id in HOLDS)


def test_row_sums_in_closed_form():
    """The sums of the rows as polynomials, added by hand."""
    for n, m in ((4, 2), (6, 3), (2, 1)):
        A, B, D = sums(n, m)
        assert 6 * n**3 + 2 * m**3 + 6 * n**2 * m + 6 * m**2 * n - n**2 - m**2 + 2 * n * m - n + 2 * m == A
        assert 4 * n**3 + 14 * n**2 * m + 16 * m**2 * n - n * m - n + 2 * m == B
        assert 4 * n**3 + 14 * n**2 * m + 8 * m**2 * n + n * m - n == D
        assert total_29(n, m) == A
        for N in (1, 100):
            assert total_30(n, m, N) - A - N * B == -m - N * (2 * n * m - n + 2 * m) + n
            assert total_31(n, m, N) - A - N * D == -m


def test_sums_over_the_smoothing_steps_with_and_without_what_may_be_left_out():
    A, B, D = sums(4, 2)
    P, C = ROWS["(16-4)"](4, 2), ROWS["(16-3)"](4, 2) + 2
    assert (A, B, D, P, C) == (684, 952, 836, 288, 20)
    assert sum_30(4, 2, 10) == A + 10 * B
    assert sum_30(4, 2, 10, covariance=True) == A + 10 * (B + P)
    assert sum_31(4, 2, 10) == A + 10 * D
    assert sum_31(4, 2, 10, weights=False, covariance=True) == A - C + 10 * (D + P)
