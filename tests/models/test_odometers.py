"""The car with two odometers and its scripted drive."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.models import build, truths


def test_every_sensor_measures_the_distance():
    F, H, u = build({"kind": "odometers"}).matrices
    np.testing.assert_array_equal(F, [[1, 1], [0, 1]])
    np.testing.assert_array_equal(H, [[1, 0], [1, 0]])
    assert u is None


@pytest.mark.parametrize(("ending", "v550", "s551", "s1500"), [("reset", 20, 12270, 31250), ("keep", 70, 12320, 78750)])
def test_mode_2_passes_the_points_of_the_note(ending, v550, s551, s1500):
    x = truths.build({"kind": "drive", "acceleration": 1.0, "ending": ending}).states(1500)
    expected = {499: (9980, 20), 500: (10000, 20), 501: (10020.5, 21), 549: (12180.5, 69), 550: (12250, v550)}
    for t, state in expected.items():
        np.testing.assert_allclose(x[t - 1], state, rtol=1e-14)
    assert x[550, 0] == pytest.approx(s551, rel=1e-14)
    assert x[-1, 0] == pytest.approx(s1500, rel=1e-14)


def test_mode_1_is_constant_speed():
    x = truths.build({"kind": "drive"}).states(1500)
    np.testing.assert_array_equal(x[:, 0], 20.0 * np.arange(1, 1501))


def test_the_script_serves_no_other_states():
    with pytest.raises(SpecError, match="S, v"):
        truths.build({"kind": "drive"}).check(("px", "py"))


def test_a_sensor_is_not_listed_twice():
    with pytest.raises(SpecError, match="twice"):
        build({"kind": "odometers", "sensors": ["A", "A"]})
