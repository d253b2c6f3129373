"""Gross errors at given epochs."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.noise import disturbances
from rkfbench.streams import Streams


def errors(**params):
    return disturbances.build({"kind": "gross_errors", "component": "A", "size": 300, **params})


def values(**params):
    sample = errors(**params).sample(Streams(1), 1500, ("A", "B"))
    assert (sample.value == sample.mean).all() and not sample.cov().any()
    np.testing.assert_array_equal(sample.flags, sample.value != 0)
    assert not sample.value[:, 1].any()
    assert (sample.value == sample.value[..., :1]).all()
    return {int(k) + 1: float(sample.value[k, 0, 0]) for k in np.flatnonzero(sample.value[:, 0, 0])}


def test_they_fall_on_every_300th_step_and_the_last_one_too():
    assert values(every=300) == {300: 300, 600: 300, 900: 300, 1200: 300, 1500: 300}


def test_the_last_step_may_be_spared():
    assert 1500 not in values(every=300, last=False)


def test_signs_alternate_from_plus():
    assert list(values(every=300, sign="alternate").values()) == [300, -300, 300, -300, 300]
    assert set(values(every=300, sign="minus").values()) == {-300}


def test_epochs_may_be_listed():
    assert values(at=[7, 20]) == {7: 300, 20: 300}


@pytest.mark.parametrize(
    ("params", "path"),
    [({"at": [3, 1501]}, ("at", 1)), ({"every": 2000}, ("every",)), ({"every": 300, "component": "C"}, ("component",))],
)
def test_faults_are_told_with_their_place(params, path):
    with pytest.raises(SpecError) as caught:
        errors(**params).check(("A", "B"), 1500)
    assert caught.value.path == path


@pytest.mark.parametrize("params", [{}, {"every": 300, "at": [1]}, {"every": 0}, {"at": [0]}])
def test_epochs_are_given_in_exactly_one_sensible_way(params):
    with pytest.raises(SpecError):
        errors(**params)
