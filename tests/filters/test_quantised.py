"""Filters that see their measurements rounded."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.filters import build
from tests.problems import linear_problem


def test_a_quantised_filter_is_the_filter_on_rounded_measurements():
    p = linear_problem()
    rounded = build("hkf").run(p.model, 0.5 * np.round(p.y / 0.5), **p.told)
    result = build({"quantised": {"filter": "hkf", "step": 0.5}}).run(p.model, p.y, **p.told)
    np.testing.assert_array_equal(result.mean, rounded.mean)
    assert np.abs(result.mean - build("hkf").run(p.model, p.y, **p.told).mean).max() > 1e-3


def test_faults_of_the_inner_filter_are_told_with_their_place():
    with pytest.raises(SpecError) as caught:
        build({"quantised": {"filter": {"use": "hkf", "threshold": -1.0}, "step": 1.0}})
    assert caught.value.path == ("quantised", "filter", "threshold")
