"""Models: equations, Jacobians against finite differences for every model of the catalogue."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench import models
from rkfbench.errors import SpecError
from rkfbench.linalg import mul
from rkfbench.models import MODELS, Observed

ARGUMENTS: dict[str, dict] = {}


def make(name):
    return models.build({"kind": name, **ARGUMENTS.get(name, {})})


@pytest.mark.parametrize("name", MODELS)
def test_shapes_and_any_axes_behind_the_components(name):
    model, rng = make(name), np.random.default_rng(1)
    n, m = len(model.states), len(model.measurements)
    x = rng.uniform(1, 2, (n, 4, 3))
    assert model.f(x, 1).shape == (n, 4, 3) and model.h(x, 1).shape == (m, 4, 3)
    np.testing.assert_allclose(model.f(x, 1)[:, 2, 1], model.f(x[:, 2, 1][:, None], 1)[:, 0], rtol=1e-12)
    np.testing.assert_allclose(model.h(x, 1)[:, 2, 1], model.h(x[:, 2, 1][:, None], 1)[:, 0], rtol=1e-12)


def test_navigation_has_the_papers_matrices():
    model = models.build({"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]})
    F, H, Bu = model.matrices
    np.testing.assert_array_equal(F, [[1, 0, 0.5, 0], [0, 1, 0, 0.5], [0, 0, 1, 0], [0, 0, 0, 1]])  # (78)
    np.testing.assert_array_equal(H, np.eye(4)[:3])  # (79)
    assert Bu is None
    pushed = models.build({"kind": "navigation", "u": 2.0})
    np.testing.assert_allclose(
        pushed.f(np.zeros((4, 1)), 1)[:, 0], [0, 0, 2 * np.sin(np.pi / 6), 2 * np.cos(np.pi / 6)]
    )


def test_an_angle_is_wrapped_also_when_other_components_are_missing():
    class Bearing(models.Linear):
        angles = (1,)
        states = measurements = ("a", "b")
        matrices = np.eye(2), np.eye(2), None

    y, z = np.array([[9.0], [3.1]]), np.array([[0.0], [-3.1]])
    np.testing.assert_allclose(Bearing().residual(y, z), [[9.0], [6.2 - 2 * np.pi]])
    np.testing.assert_allclose(Observed(Bearing(), [1]).residual(y[1:], z[1:]), [[6.2 - 2 * np.pi]])
    assert models.wrap(np.array(np.pi)) == -np.pi


@pytest.mark.parametrize(
    ("spec", "says"),
    [
        ({"kind": "navigatoin"}, "did you mean 'navigation'"),
        ({"kind": "navigation", "dt": 0}, "greater than 0"),
        ({"kind": "navigation", "observed": ["px", "px"]}, "listed twice"),
        ({"kind": "navigation", "observed": []}, "at least 1"),
        ({"dt": 1}, "mapping with 'kind'"),
    ],
)
def test_a_model_that_makes_no_sense_is_said(spec, says):
    with pytest.raises(SpecError, match=says):
        models.build(spec)


@pytest.mark.parametrize("name", MODELS)
def test_a_motion_that_is_called_affine_is_its_jacobian_and_a_constant(name):
    model, rng = make(name), np.random.default_rng(2)
    n = len(model.states)
    x, other = rng.uniform(1, 50, (2, n, 5))
    steps = np.linalg.norm(model.f(x, 3) - model.f(other, 3) - mul(model.F(x, 3), x - other))
    assert model.affine == bool(steps < 1e-9)
    if model.affine:
        np.testing.assert_array_equal(model.F(x, 3), model.F(other, 3))


def test_wrapping_leaves_what_lies_in_the_period_as_it_is():
    angles = np.concatenate([np.linspace(-np.pi, np.pi, 1001)[:-1], [1e-17, -1e-17, 0.1 + 0.2]])
    np.testing.assert_array_equal(models.wrap(angles), angles)
    np.testing.assert_allclose(models.wrap(angles[10:-10] + 6 * np.pi), angles[10:-10], atol=1e-14)
    with np.errstate(invalid="ignore"):
        assert np.isnan(models.wrap(np.array([np.nan, np.inf]))).all()
