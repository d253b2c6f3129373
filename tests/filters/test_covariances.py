"""What is no covariance is refused in the same words by every filter, and a bad run ends that run only."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench import filters
from rkfbench.contract import problems
from rkfbench.errors import SpecError
from rkfbench.filters import FILTERS
from rkfbench.filters.covariances import check
from rkfbench.filters.recursion import prepare
from rkfbench.models import build
from tests.contract import arguments, serves
from tests.problems import linear_problem

NOT_TOLD = {"clairvoyant_kf", "truth"}  # they take Q and R, or all, from the record
FAULTS = {
    "R is not finite": {"R": np.nan},
    "R is not symmetric": {"R": "skew"},
    "R is not positive definite": {"R": 0.0},
    "Q is not finite": {"Q": np.inf},
    "Q is not positive semidefinite": {"Q": -0.1},
    "P0 is not symmetric": {"P0": "skew"},
    "P0 is not positive semidefinite": {"P0": -1.0},
    "x0 is not finite": {"x0": np.nan},
}
RUNNING = [
    (name, next(each for each in problems() if serves(name, each.name)))
    for name, entry in FILTERS.items()
    if "file" not in entry.needs and name not in NOT_TOLD
]


def faulty(value, like):
    like = np.asarray(like, float)
    if value == "skew":
        return like + np.triu(np.ones_like(like), 1)
    return np.full_like(like, value) if not np.isfinite(value) else value * np.eye(len(like))


@pytest.mark.parametrize(("name", "problem"), RUNNING, ids=[name for name, _ in RUNNING])
def test_every_filter_refuses_what_is_no_covariance(name, problem):
    experiment, world = problem.experiment, problem.world
    told = {"x0": experiment.told.mean, "P0": experiment.told.P0, "Q": experiment.told.Q, "R": experiment.told.R}
    filt = filters.build(name, **arguments(name, problem.name))
    for message, ((key, value),) in ((message, fault.items()) for message, fault in FAULTS.items()):
        with pytest.raises(SpecError, match=f"^{message}$"):
            filt.run(experiment.assumed_model, world.y, **{**told, key: faulty(value, told[key])}, known=world.known)


def test_the_step_or_run_of_a_wrong_matrix_is_told():
    R = np.tile(np.eye(2)[None, ..., None], (5, 1, 1, 1))
    R[3] *= -1
    with pytest.raises(SpecError, match=r"^R is not positive definite at step 4$"):
        check("R", R, singular=False)
    Q = np.tile(np.eye(2)[None, ..., None], (5, 1, 1, 3))
    Q[1, ..., 2] = [[1, 2], [2, 1]]
    with pytest.raises(SpecError, match=r"^Q is not positive semidefinite at step 2 in run 2$"):
        check("Q", Q, singular=True)


def test_singular_matrices_and_rounding_are_no_fault():
    B = np.random.default_rng(1).normal(size=(4, 3))
    for A in (np.zeros((4, 4)), B @ B.T, 1e-20 * B @ B.T):
        check("Q", A[..., None], singular=True)
        check("Q", np.repeat(A[..., None], 3, axis=2), singular=True)


@pytest.mark.parametrize("name", ["kf", "hkf", "aladkf", "ukf", "mckf", "hkf_regression"])
@pytest.mark.parametrize("which", ["P0", "Q", "R", "x0"])
def test_a_run_whose_own_matrix_is_not_finite_fails_alone(name, which):
    p = linear_problem()
    y, *told = prepare(p.model, p.y, **p.told)
    shared = dict(zip(("x0", "P0", "Q", "R"), told, strict=True))[which]
    own = np.repeat(shared[..., :1], y.shape[2], axis=-1)
    own[..., 1] = np.nan
    estimate = filters.build(name).run(p.model, p.y, **{**p.told, which: own})
    assert np.flatnonzero(estimate.failed).tolist() == [1]


def test_what_is_measured_is_told_once():
    with pytest.raises(SpecError) as error:
        build({"kind": "navigation", "observed": ["q"]})
    assert str(error.value) == "observed.0: should be 'px', 'py', 'vx' or 'vy'"
    with pytest.raises(SpecError, match="observed: Tuple should have at least 1 item"):
        build({"kind": "navigation", "observed": []})
