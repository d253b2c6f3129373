"""The contract of the catalogue: what every filter that is listed there must keep. A new filter is tested by being
listed.

A filter that needs a nonlinear model, or cannot run on these problems, says so through its `check`, and is run on the
models it serves.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from rkfbench import contract
from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import FILTERS, build
from tests.contract import PROBLEMS, arguments, serves

RUNNING = [name for name, entry in FILTERS.items() if "file" not in entry.needs]  # the others ran elsewhere
RANDOMISED = {name for name, entry in FILTERS.items() if "streams" in entry.needs}


# As its paper prints it, fpmcs has a covariance for a diagonal R only: that is one of the claims judged.
EXCEPT = {("fpmcs", contract.covariances)}


def test_every_filter_of_the_catalogue_serves_some_problem():
    assert not [name for name in RUNNING if not any(serves(name, problem) for problem in PROBLEMS)]


@pytest.mark.parametrize(
    ("name", "problem", "check"),
    [
        pytest.param(name, problem, check, id=f"{check.__name__}: {name} on {problem.name}")
        for check in contract.CHECKS
        for name in RUNNING
        for problem in contract.problems()
        if serves(name, problem.name) and (name, check) not in EXCEPT
    ],
)
def test_every_filter_of_the_catalogue_keeps_the_contract(name, problem, check):
    filt = build(name, **arguments(name, problem.name))
    assert list(check(contract.Subject(filt, problem, name in RANDOMISED))) == []


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        pytest.param(name, problem, id=f"{name} on {problem.name}")
        for name in RUNNING
        for problem in contract.problems()
        if serves(name, problem.name) and name not in RANDOMISED
    ],
)
def test_infinite_measurements_end_a_run(name, problem):
    subject = contract.Subject(build(name, **arguments(name, problem.name)), problem)
    y = subject.y.copy()
    y[2:, :, 5] = np.inf
    assert subject.estimate(y=y).failed[5]


@pytest.mark.parametrize(
    ("name", "limit", "problem"),
    [
        pytest.param(name, limit, problem, id=f"{name} {dict(limit.params)} = {limit.equals} on {problem.name}")
        for name, entry in FILTERS.items()
        for limit in entry.limits
        for problem in contract.problems()
        if serves(name, problem.name) and (limit.where != "linear" or problem.experiment.model.linear)
    ],
)
def test_declared_limits_hold(name, limit, problem):
    make = partial(build, name, **arguments(name, problem.name))
    assert list(contract.limit_holds(make, limit, problem)) == []


def test_an_unknown_filter_or_parameter_is_said():
    with pytest.raises(SpecError, match="did you mean 'hkf'"):
        build("hfk")
    with pytest.raises(SpecError, match="did you mean 'threshold'"):
        build("hkf", treshold=1.0)
    with pytest.raises(SpecError, match="greater than 0"):
        build("hkf", threshold=-1.0)
    assert isinstance(PROBLEMS["navigation"][0], Experiment)
