"""The bundled scenario `navigation`: closed forms of the FP-MCS note, and what its cases share."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench import scenario
from rkfbench.experiment import Experiment
from rkfbench.streams import Streams
from rkfbench.study.compute import compute

PRIOR, POST, SMOOTHED = (
    (2.14395329, 0.45637802),
    (1.03687540, 0.34737802),
    (0.40601447, 0.09087281),
)  # position, velocity


@pytest.fixture(scope="module")
def cells():
    return {cell.case: cell.spec for cell in scenario.load("navigation").cells}


@pytest.mark.parametrize("case", ["L", "V900", "C900", "C25"])
def test_kalman_filter_and_smoother_have_their_closed_form_errors(cells, case):
    """A linear filter's mean square error is its own covariance, whatever the law of white noise with Q and R."""
    runs = 512 if case in ("L", "C25") else 256
    found = compute(cells[case], 1, 0, runs, ["kf", "ks"]).filters
    for label, name, expected in (("kf", "mse_prior", PRIOR), ("kf", "mse", POST), ("ks", "mse", SMOOTHED)):
        for states, value in zip(("px,py", "vx,vy"), expected, strict=True):
            errors = found[label].values[f"{name}[{states}]@j"] / 2
            assert abs(errors.mean() - value) < 4 * errors.std(ddof=1) / np.sqrt(len(errors))


def test_cases_share_their_noise(cells):
    worlds = {case: Experiment.of(cells[case]).simulate(Streams(2)) for case in ("L", "V900", "C900", "C25")}
    np.testing.assert_array_equal(worlds["L"].v.value, worlds["V900"].v.value)
    np.testing.assert_array_equal(worlds["C900"].w.value, worlds["V900"].w.value)
    np.testing.assert_array_equal(worlds["C25"].w.value, worlds["C900"].w.value[:100])
    shots = worlds["L"].w.value - worlds["C900"].w.value
    assert (np.abs(shots).max((1, 2)) > 0).nonzero()[0].max() <= 50


def test_correntropy_locks_out_in_the_literal_case(cells):
    """After shots in the process a small sigma ignores all later measurements: every run is lost, none fails."""
    found = compute(cells["L25"], 1, 0, 128, ["mckf[sigma=1]", "fpmcs[sigma=1]", "kf"]).filters
    assert found["mckf[sigma=1]"].lost.mean() > 0.9
    np.testing.assert_array_equal(found["mckf[sigma=1]"].lost, found["fpmcs[sigma=1]"].lost)
    assert not found["fpmcs[sigma=1]"].failed.any()
    assert found["kf"].lost.mean() < 0.6


def test_the_particle_reference_beats_all_in_the_clean_case(cells):
    found = compute(cells["C25"], 1, 0, 128, ["axes-2000", "ks", "fpmcs[sigma=3]", "clairvoyant_ks"]).filters
    error = {label: each.values["mse[px,py]@j"].mean() for label, each in found.items()}
    assert error["clairvoyant_ks"] < error["axes-2000"] < 0.8 * min(error["ks"], error["fpmcs[sigma=3]"])
