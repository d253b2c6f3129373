"""One filter for each independent part of a model: the same answer as the whole, and what does not fall apart."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.models import Navigation

AXES = [["px", "vx"], ["py", "vy"]]
TOLD = {"x0": np.array([1.0, 1, 0, 0]), "P0": np.diag([4.0, 4, 3, 3]), "Q": 0.109 * np.eye(4), "R": 2.008 * np.eye(2)}
Y = np.random.default_rng(1).standard_normal((30, 2, 8))


@pytest.mark.parametrize("spec", ["kf", {"use": "mckf", "sigma": 2.0}, {"use": "fpmcs", "at": 20, "lag": 5}])
def test_two_axes_apart_are_the_whole(spec):
    model = Navigation(u=0.3)
    whole, parts = build(spec), build("decoupled", filter=spec, parts=AXES)
    a = whole.run(model, Y, keep=("cov", "prior_mean"), **TOLD)
    b = parts.run(model, Y, keep=("cov", "prior_mean"), **TOLD)
    np.testing.assert_allclose(b.mean, a.mean, atol=1e-10)
    np.testing.assert_allclose(b.extras["prior_mean"], a.extras["prior_mean"], atol=1e-10)
    np.testing.assert_allclose(b.cov + np.zeros(8), a.cov + np.zeros(8), atol=1e-9)
    assert b.target == a.target


def test_covariances_told_for_each_step_are_divided():
    told = {**TOLD, "Q": np.repeat(TOLD["Q"][None, ..., None], 30, axis=0)}
    apart = build("decoupled", filter="kf", parts=AXES)
    one, other = (apart.run(Navigation(), Y, **each) for each in (TOLD, told))
    np.testing.assert_allclose(other.mean, one.mean, atol=1e-12)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([["px", "py"], ["vx", "vy"]], "does not fall into these parts"),
        ([["px", "vx"], ["py"]], "each once"),
        ([["px", "vx"], ["py", "vz"]], "no state 'vz'"),
    ],
)
def test_wrong_parts_are_said(parts, message):
    with pytest.raises(SpecError, match=message):
        build("decoupled", filter="kf", parts=parts).check(Navigation())


def test_a_covariance_that_couples_the_parts_is_said():
    Q = 0.109 * np.eye(4)
    Q[0, 1] = Q[1, 0] = 0.05
    with pytest.raises(SpecError, match="couples the parts"):
        build("decoupled", filter="kf", parts=AXES).run(Navigation(), Y, **{**TOLD, "Q": Q})
