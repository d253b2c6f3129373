"""Filters that see their measurements rounded."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import build
from rkfbench.streams import Streams
from rkfbench.study.wide import alone
from tests.contract import SPECS
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


def test_a_quantised_filter_is_told_what_its_experiment_tells_the_filter():
    filters = [{"use": "pf"}, {"use": "ks"}, *({"quantised": {"filter": name, "step": 1e-12}} for name in ("pf", "ks"))]
    spec = {**SPECS["navigation"], "steps": 30, "point": {"at": 20, "lag": 10}}
    experiment = Experiment.of({**spec, "filters": [{"label": f"f{i}", **each} for i, each in enumerate(filters)]})
    world = experiment.simulate(Streams(1))
    pf, ks, rounded_pf, rounded_ks = (alone(experiment, world, Streams(1), label, ()) for label in experiment.filters)
    np.testing.assert_allclose(rounded_pf.mean, pf.mean, atol=1e-6)
    np.testing.assert_allclose(rounded_ks.mean, ks.mean, atol=1e-6)
    assert rounded_ks.target == experiment.filters["f3"][0].target == 20
