import numpy as np
import pytest

from rkfbench.models import build
from rkfbench.models.altitude import Altitude
from rkfbench.models.range_bearing import RangeBearing
from rkfbench.models.ungm import UNGM

QUADRANTS = [(a, b) for a in (1, -1) for b in (1, -1)]


def states(model):
    rng = np.random.default_rng(3)
    n = len(model.states)
    for sx, sy in QUADRANTS:
        x = rng.uniform(1, 3, n)
        x[0] *= 7 * sx
        if n > 1:
            x[1] *= 5 * sy
        yield x


def central(g, x, eps=1e-5):
    return np.stack([(g(x + eps * e) - g(x - eps * e)) / (2 * eps) for e in np.eye(len(x))], axis=1)


@pytest.mark.parametrize("model", [RangeBearing(), UNGM(), Altitude(), Altitude(dt=0.5, angle="atan_wrap")], ids=str)
def test_jacobians_are_derivatives_in_all_four_quadrants(model):
    for x in states(model):
        np.testing.assert_allclose(model.H(x, 3), central(lambda s: model.h(s, 3), x), atol=1e-8)
        np.testing.assert_allclose(model.F(x, 3), central(lambda s: model.f(s, 3), x), atol=1e-7)


@pytest.mark.parametrize("model", [RangeBearing(), UNGM(), Altitude()], ids=str)
def test_any_axes_may_stand_behind_the_state(model):
    x = np.stack(list(states(model)), axis=1)
    many = np.stack([x, 2 * x], axis=1)
    assert model.h(many, 2).shape == (len(model.measurements), 2, 4)
    np.testing.assert_array_equal(model.f(many, 2)[:, 1], model.f(2 * x, 2))
    np.testing.assert_array_equal(model.h(many, 2)[:, 0], model.h(x, 2))
    one = np.stack([np.broadcast_to(model.H(s, 2), (len(model.measurements), len(s))) for s in x.T], axis=-1)
    np.testing.assert_allclose(model.H(x, 2), one, rtol=1e-14)


def test_the_growth_model_counts_its_cosine_from_0():
    assert UNGM().f(np.zeros(1), 1)[0] == 8.0
    np.testing.assert_allclose(UNGM().f(np.array([2.0]), 3), 1.0 + 10.0 + 8 * np.cos(2.4))


def test_altitude_measures_bearing_range_height_and_range_rate():
    y = Altitude().h(np.array([3.0, 4.0, 12.0, 1.0, 2.0, -1.0]), 1)
    np.testing.assert_allclose(y, [np.arctan2(4, 3), 13.0, 12.0, (3 + 8 - 12) / 13])


@pytest.mark.parametrize(
    ("angle", "bearing", "difference"),
    [
        ("atan2_wrap", -3 * np.pi / 4, 0.2),
        ("atan2_raw", -3 * np.pi / 4, 0.2 - 2 * np.pi),
        ("atan_wrap", np.pi / 4, 0.2),
        ("atan_raw", np.pi / 4, 0.2 - np.pi),
    ],
)
def test_the_angle_switch_rules_bearings_and_their_differences(angle, bearing, difference):
    model = build({"kind": "range_bearing", "angle": angle})
    np.testing.assert_allclose(model.h(np.array([-1.0, -1.0]), 1)[1], bearing)
    half = np.pi if angle.startswith("atan2") else np.pi / 2
    y, z = np.array([1.0, -half + 0.1]), np.array([0.0, half - 0.1])
    np.testing.assert_allclose(model.residual(y, z), [1.0, difference])
    assert model.angles == ((1,) if angle.endswith("wrap") else ())


def test_atan_has_a_limit_on_the_axis():
    np.testing.assert_allclose(RangeBearing("atan_raw").h(np.array([0.0, -2.0]), 1)[1], -np.pi / 2)
