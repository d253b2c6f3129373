"""A cell from its description: everything that does not fit together is said at once, each fault with its path."""

from __future__ import annotations

import copy

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.streams import Streams
from tests.contract import SPECS

BASE = SPECS["navigation"]


def changed(path, value):
    spec = copy.deepcopy(BASE)
    *parents, last = path
    node = spec
    for key in parents:
        node = node[key]
    node[last] = value
    return spec


@pytest.mark.parametrize(
    ("path", "value", "fault", "says"),
    [
        (("model", "kind"), "nav", ("model", "kind"), "unknown model"),
        (("start", "truth"), [1, 1], ("start", "truth"), "2 elements, the model has 4"),
        (("assumed", "mean"), [0, 0, 0], ("assumed", "mean"), "3 elements, the model has 4"),
        (("assumed", "cov"), [1, 2], ("assumed", "cov"), "expected 4 x 4"),
        (("assumed", "cov"), 0.0, ("assumed", "cov"), "positive definite"),
        (("assumed", "measurement_cov"), "bdy", ("assumed", "measurement_cov"), "did you mean 'body'"),
        (("process_noise",), {"kind": "gaussian", "cov": [[1, 2], [3, 4]]}, ("process_noise", "cov"), "expected 4 x 4"),
        (("measurement_noise", "rate"), -0.1, ("measurement_noise", "rate"), "greater than or equal to 0"),
        (("filters", 0), {"label": "kf", "use": "kff"}, ("filters", 0, "use"), "did you mean 'kf'"),
        (
            ("filters", 0),
            {"label": "h", "use": "hkf", "treshold": 1.0},
            ("filters", 0, "treshold"),
            "did you mean 'threshold'",
        ),
        (("metrics",), ["rmse[pz]"], ("metrics", 0), "no state 'pz'"),
        (("metrics",), ["mse@13"], ("metrics", 0), "not within 1..12"),
        (("metrics",), ["cond_ratio_top_psi(over=ekf)"], ("metrics", 0), "which is no filter here"),
        (("lost",), {"states": ["pz"], "limit": 1.0}, ("lost", "states", 0), "no state 'pz'"),
        (("lost",), {"states": ["px"], "limit": 1.0, "after": 12}, ("lost",), "not within 1..12"),
    ],
)
def test_a_fault_is_said_with_its_path(path, value, fault, says):
    with pytest.raises(SpecError) as caught:
        Experiment.of(changed(path, value))
    assert [error.path for error in caught.value] == [fault]
    assert says in str(caught.value)


def test_all_faults_are_said_at_once():
    spec = changed(("start", "truth"), [1])
    spec["metrics"], spec["assumed"]["mean"] = ["rmsee"], [0]
    with pytest.raises(SpecError) as caught:
        Experiment.of(spec)
    assert {error.path[0] for error in caught.value} == {"start", "metrics", "assumed"}


def test_the_truth_follows_the_model_and_the_measurements_the_truth():
    experiment = Experiment.of(BASE)
    world = experiment.simulate(Streams(2))
    F, H, _ = experiment.model.matrices
    before = np.concatenate([np.ones((1, 4, 128)), world.x[:-1]])
    np.testing.assert_allclose(world.x, F @ before + world.w.value, atol=1e-12)
    np.testing.assert_allclose(world.y, H @ world.x + world.v.value, atol=1e-12)


def test_a_drawn_start_and_a_drawn_estimate_have_the_covariances_that_they_say():
    spec = changed(("start", "truth"), {"mean": [1, 2, 3, 4], "cov": [4, 1, 1, 1]})
    spec["assumed"]["mean_drawn"] = True
    spec["process_noise"] = None
    experiment = Experiment.of(spec)
    world = experiment.simulate(Streams(2, groups=30))
    start = np.linalg.solve(experiment.model.matrices[0], world.x[0])
    N = start.shape[1]
    for sample, C in ((start, np.diag([4.0, 1, 1, 1])), (world.x0, experiment.told.P0)):
        d = sample - sample.mean(1, keepdims=True)
        products = d[:, None] * d[None]
        assert (np.abs(products.mean(-1) - C) < 5 * products.std(-1) / np.sqrt(N)).all()


def test_a_filter_may_be_told_something_else():
    spec = changed(
        ("filters",),
        [
            {"label": "kf", "use": "kf"},
            {"label": "proud", "use": "kf", "assumed": {"measurement_cov": 0.01, "mean": None}},
        ],
    )
    experiment = Experiment.of(spec)
    assert experiment.filters["kf"][1].R[0, 0] == 1.0
    np.testing.assert_array_equal(experiment.filters["proud"][1].R, 0.01 * np.eye(3))
    np.testing.assert_array_equal(experiment.filters["proud"][1].P0, experiment.told.P0)


def test_a_known_input_moves_the_truth_and_the_filters_only_if_they_use_it():
    for uses in (True, False):
        spec = {**BASE, "input": {"value": 0.5, "filters_use_it": uses}}
        experiment = Experiment.of(spec)
        assert experiment.model.u == 0.5 and experiment.assumed_model.u == (0.5 if uses else 0.0)
