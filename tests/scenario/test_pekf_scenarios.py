"""The scenarios of the PEKF paper: their readings differ in what the note says and in nothing else, and new
combinations need no code.
"""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.experiment import Experiment
from rkfbench.scenario import load
from rkfbench.study.compute import compute


def cells(name):
    return {(cell.reading, cell.case): cell.spec for cell in load(name).cells}


def test_conjecture_differs_from_literal_in_four_switches():
    specs = cells("altitude-tracking")
    for case in ("R1", "R2"):
        literal, conjecture = specs["literal", case], specs["conjecture", case]
        changed = {key for key in literal if literal[key] != conjecture[key]}
        assert changed == {"process_noise", "model", "start", "score"}
        assert conjecture["model"] == {**literal["model"], "angle": "atan2_raw"}
        assert conjecture["start"] == {"truth": {"mean": literal["assumed"]["mean"], "cov": 1}}
        assert (literal["score"], conjecture["score"]) == ("rmse", "axis_rmse[px,py,pz]")


@pytest.mark.parametrize(
    ("reading", "axis"),
    [
        ("literal", [[5 / 3, 5 / 2], [5 / 2, 5]]),
        ("conjecture", [[65 / 12, 5 * 3**0.5 / 4], [5 * 3**0.5 / 4, 5 / 4]]),
    ],
)
def test_the_factor_of_the_process_noise_changes_the_truth_and_not_what_the_filters_are_told(reading, axis):
    experiment = Experiment.of(cells("altitude-tracking")[reading, "R1"])
    np.testing.assert_allclose(experiment.process.cov, np.kron(axis, np.eye(3)), atol=1e-12)
    np.testing.assert_allclose(experiment.told.Q, 5 * np.kron([[1 / 3, 1 / 2], [1 / 2, 1]], np.eye(3)))


def test_the_two_measurement_noises_are_variances():
    specs = cells("altitude-tracking")
    for case, variance in (("R1", 25.0), ("R2", 0.01)):
        np.testing.assert_allclose(
            np.diag(Experiment.of(specs["literal", case]).told.R), [(np.pi / 8) ** 2, *3 * [variance]]
        )


def test_the_growth_model_is_swept_over_the_variances_of_figures_2_and_3():
    assert [cell.point["cov"] for cell in load("ungm").cells] == [1, *range(10, 101, 10)]


def test_all_sixteen_combinations_of_the_switches_are_offered():
    scenario = load("altitude-switches")
    assert len(scenario.cells) == 2 * 8 and sum(not cell.extra for cell in scenario.cells) == 2
    assert {"rmse", "axis_rmse[px,py,pz]"} <= set(scenario.cells[0].spec["metrics"])


def test_combinations_that_no_paper_tried_run_from_a_description():
    spec = {
        **cells("range-bearing")["literal", ""],
        "steps": 4,
        "metrics": ["rmse"],
        "filters": [
            {
                "label": f"{moments} {update}",
                "moments": moments,
                "weight": {"huber": {"threshold": 1.345}},
                "update": {update: {}},
            }
            for moments in ("cubature", "unscented", "divided_difference", "taylor")
            for update in ("progressive", "tempered", "iterated")
        ],
    }
    labels = [each["label"] for each in spec["filters"]]
    result = compute(spec, seed=1, block=0, runs=20, labels=labels)
    for label in labels:
        assert not result.filters[label].failed.any() and np.isfinite(result.filters[label].values["rmse"]).all()
