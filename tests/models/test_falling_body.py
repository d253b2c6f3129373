"""The falling body: its trajectory, its Jacobian, its bounds."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.models import build


def test_the_truth_passes_the_points_of_the_note():
    body, x = build({"kind": "falling_body", "dt": 1.0, "rk4_steps": 16}), np.array([3e5, 2e4, 1e-3])[:, None]
    expected = {
        5: (200017.414, 19981.9863), 10: (102455.406, 17752.8946), 15: (50645.576, 4080.3567),
        20: (39452.624, 1238.5364), 30: (32591.946, 396.7570), 60: (26732.308, 104.4622),
    }  # fmt: skip
    for t in range(1, 61):
        x = body.f(x, t)
        if t in expected:
            assert x[0, 0] == pytest.approx(expected[t][0], abs=2e-3)
            assert x[1, 0] == pytest.approx(expected[t][1], abs=2e-4)


def test_one_second_from_the_filters_start():
    x = build({"kind": "falling_body", "dt": 1.0, "rk4_steps": 20}).f(np.array([3e5, 2e4, 3e-5]), 1)
    np.testing.assert_allclose(x, (280000.0026, 19999.99369, 3e-5), rtol=1e-9)


def test_small_and_large_integration_steps_agree_far_below_the_noise():
    x0 = np.array([6e4, 1e4, 1e-3])
    coarse, fine = (build({"kind": "falling_body", "dt": 1.0, "rk4_steps": n}).f(x0, 1) for n in (16, 160))
    assert np.abs(coarse - fine)[0] < 1e-4


def test_the_jacobians_equal_finite_differences():
    body = build({"kind": "falling_body", "dt": 0.5, "rk4_steps": 8})
    x = np.array([[6e4, 1.4e4, 8e-4], [3e5, 2e4, 3e-5]]).T
    F, H = body.F(x, 1), body.H(x, 1)
    for i, step in enumerate((10.0, 1.0, 1e-7)):
        d = np.zeros((3, 1))
        d[i] = step
        np.testing.assert_allclose(F[:, i], (body.f(x + d, 1) - body.f(x - d, 1)) / (2 * step), rtol=2e-5, atol=1e-9)
        np.testing.assert_allclose(H[:, i], (body.h(x + d, 1) - body.h(x - d, 1)) / (2 * step), atol=1e-8)


def test_the_model_serves_any_trailing_axes():
    body, x = build({"kind": "falling_body"}), np.array([6e4, 1.4e4, 8e-4])
    many = np.broadcast_to(x[:, None, None], (3, 7, 4))
    np.testing.assert_allclose(body.f(many, 1)[:, 3, 2], body.f(x, 1), rtol=1e-14)
    assert body.h(many, 1).shape == (1, 7, 4)


@pytest.mark.parametrize(("x", "P11", "sound"), [
    ((3e5, 2e4, 1e-3), 1e6, True), ((1.1e7, 2e4, 1e-3), 1e6, False), ((3e5, -1.1e6, 1e-3), 1e6, False),
    ((3e5, 2e4, 10.1), 1e6, False), ((3e5, 2e4, 1e-3), 1.1e16, False), ((np.nan, 2e4, 1e-3), 1e6, False),
])  # fmt: skip
def test_what_is_no_falling_body_any_more(x, P11, sound):
    P = np.diag([P11, 1.0, 1.0])[..., None]
    assert build({"kind": "falling_body"}).plausible(np.array(x)[:, None], P) == [sound]
