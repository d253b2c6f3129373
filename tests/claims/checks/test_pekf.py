import numpy as np
import pytest

from rkfbench.claims.checks import checks_of
from rkfbench.claims.checks.pekf import _residual

CHECKS = checks_of("pekf-2017")
FAIL = ("4-b", "4-b-scalar-1", "4-b-scalar-10", "4-d-ungm-100")  # findings: these statements do not hold


@pytest.mark.parametrize("id", CHECKS)
def test_every_check_says_what_was_found(id):
    outcome = CHECKS[id]()
    assert outcome.holds == (id.removeprefix("pekf.") not in FAIL), outcome.note
    assert outcome.note and np.isfinite(outcome.deviation)


def test_the_progressive_update_stays_a_third_of_the_way_from_the_flow_it_is_said_to_discretise():
    assert 0.25 < CHECKS["pekf.4-b"]().deviation < 0.4


def test_the_differential_equation_is_not_met_by_a_flow_of_twice_the_speed():
    P = np.array([[2.0, 0.3], [0.3, 1.0]])
    R, H, y, mean = np.eye(1), np.array([[1.0, 0.5]]), np.array([2.0]), np.zeros(2)
    expected = -0.5 * float((y @ y) + (H @ P @ H.T)[0, 0])
    x = np.array([0.7, -0.2])
    _, rest = _residual(x, mean, P, y, R, lambda s: H @ s, lambda s: H, expected)
    _, wrong = _residual(x, mean, P, y, R / 2, lambda s: H @ s, lambda s: H, expected)
    assert abs(rest) < 1e-12 < 0.1 < abs(wrong)
