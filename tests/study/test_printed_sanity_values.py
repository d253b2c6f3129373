"""Numbers that the DAF and NRUKF notes give for comparison, against ours, within four standard errors."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench.scenario import load
from rkfbench.study.compute import compute

RUNS = 256


def values(scenario, case, label, metric):
    found = load(scenario)
    cell = next(cell for cell in found.cells if cell.case == case)
    spec = {
        **cell.spec,
        "metrics": [metric],
        "filters": [each for each in cell.spec["filters"] if each["label"] == label],
    }
    result = compute(spec, found.seed, 0, RUNS, [label]).filters[label]
    return np.where(result.failed, np.inf, result.values[metric])


@pytest.mark.parametrize(
    ("case", "label", "value"), [("case1", "skf", 0.530), ("case1", "daf", 0.576), ("case2", "skf", 0.628)]
)
def test_mean_rmse_of_the_odometers(case, label, value):
    rmse = values("odometers", case, label, "rmse[S]")
    assert abs(rmse.mean() - value) <= 4 * np.hypot(0.001, rmse.std() / np.sqrt(RUNS))


@pytest.mark.parametrize(
    ("rate", "label", "value", "se"),
    [
        (0, "ukf", 98.3, 1.0), (0, "hukf", 97.8, 1.4), (0, "nrukf_r", 98.9, 1.5),
        (0.3, "ukf", 293.2, 5.0), (0.3, "hukf", 169.7, 2.7), (0.3, "nrukf_r", 165.1, 2.9),
    ],
)  # fmt: skip
def test_median_rmse_of_the_falling_body(rate, label, value, se):
    rmse = values("falling-body", f"track,rate={rate}", label, "rmse[altitude]")
    resampled = np.random.default_rng(1).choice(rmse, (200, RUNS))
    assert abs(np.median(rmse) - value) <= 4 * np.hypot(se, np.median(resampled, axis=1).std())
