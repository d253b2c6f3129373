import numpy as np
import pytest

from rkfbench.filters import build
from rkfbench.filters.flow import grid
from rkfbench.models.range_bearing import RangeBearing
from tests.oracles.linear import linear_filter
from tests.problems import linear_problem

# the set-up of C5: range-bearing, a prior far off, a precise range
X, P, Y, R = np.array([20.0, 80.0]), 100 * np.eye(2), np.array([120.0, 0.9]), np.diag([1.0, 6e-3])


def update(scheme, **params):
    filt = build({"moments": "taylor", "update": {scheme: params} if params else scheme})
    return filt.correct(RangeBearing(), X[:, None], P[..., None], Y[:, None], 1, R[..., None])


@pytest.mark.parametrize("method", ["LSODA", "Radau", "BDF"])
def test_the_flow_is_the_kalman_filter_for_linear_measurements(method):
    p = linear_problem(runs=2, steps=1)
    F, H, _ = p.model.matrices
    est = build({"moments": "taylor", "update": {"flow": {"method": method}}}).run(p.model, p.y, **p.told)
    for i in range(2):
        x, cov, _ = linear_filter(F, H, p.Q, p.R, p.x0, p.P0, p.y[..., i])
        np.testing.assert_allclose(est.mean[..., i], x, atol=3e-6)
        np.testing.assert_allclose(est.cov[..., i], cov, atol=3e-6)


@pytest.mark.parametrize(("scheme", "saturated"), [("tempered", False), ("progressive", True)])
def test_small_steps_converge_to_their_flow_at_first_order(scheme, saturated):
    limit = update("flow", saturated=saturated)
    error = [np.abs(update(scheme, dl=dl).x - limit.x).max() for dl in (1e-3, 1e-4)]
    assert error[1] < 2e-3
    assert 8 < error[0] / error[1] < 12


def test_the_two_flows_are_far_apart():
    assert (np.abs(update("flow").x - update("flow", saturated=True).x) > 5).all()


def test_the_graded_stand_in_is_near_the_solver_and_a_finer_grid_nearer():
    limit = update("flow").x
    coarse = np.abs(update("graded").x - limit).max()
    fine = np.abs(update("graded", ratio=1.05, cap=0.01).x - limit).max()
    assert fine < 0.5 * coarse < 0.05 * np.abs(limit - X[:, None]).max()


def test_the_graded_grid_adds_up_to_1():
    lengths = np.array(grid(1e-8, 1.15, 0.03))
    assert abs(lengths.sum() - 1) < 1e-12 and lengths.min() > 0 and lengths.max() <= 0.03
    np.testing.assert_allclose(lengths[1:50] / lengths[:49], 1.15)
