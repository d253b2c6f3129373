from types import SimpleNamespace

import numpy as np
import pytest

from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import Estimate
from rkfbench.metrics import Trial, get
from tests.contract import SPECS

T, N, RUNS = 6, 2, 5
RNG = np.random.default_rng(8)
TRUTH = RNG.normal(50, 5, (T, N, RUNS))
MEAN = TRUTH + RNG.normal(0, 3, (T, N, RUNS))
A = RNG.standard_normal((T, N, N, RUNS))
COV = np.einsum("tikm,tjkm->tijm", A, A) + 0.1 * np.eye(N)[:, :, None]


def value(text, mean=MEAN, cov=COV, truth=TRUTH, score="rmse"):
    world = SimpleNamespace(x=truth, y=np.zeros((T, 1, RUNS)))
    experiment = SimpleNamespace(model=SimpleNamespace(states=("px", "py")), score=score)
    return get(text)(Trial(experiment, world, None, Estimate(mean, cov, np.zeros(RUNS, bool))))


def test_axis_rmse_is_rmse_over_the_root_of_the_number_of_states():
    np.testing.assert_allclose(value("axis_rmse"), value("rmse") / np.sqrt(2))
    np.testing.assert_allclose(value("axis_rmse[py]"), value("rmse[py]"))


def test_stated_rmse_is_the_root_of_the_mean_trace():
    np.testing.assert_allclose(value("stated_rmse") ** 2, np.einsum("tiim->tm", COV).mean(0))


def test_small_errors_split_into_radial_and_tangential_parts():
    mean = TRUTH + 1e-4 * RNG.standard_normal(TRUTH.shape)
    parts = value("radial_rmse", mean) ** 2 + value("tangential_rmse", mean) ** 2
    np.testing.assert_allclose(parts, value("rmse", mean) ** 2, rtol=1e-4)


def test_a_turned_estimate_has_a_tangential_error_only():
    angle = np.arctan2(TRUTH[:, 1], TRUTH[:, 0]) + 0.1
    r = np.hypot(*TRUTH.swapaxes(0, 1))
    mean = np.stack([r * np.cos(angle), r * np.sin(angle)], axis=1)
    np.testing.assert_allclose(value("radial_rmse", mean), 0, atol=1e-12)
    np.testing.assert_allclose(value("tangential_rmse@3", mean), 0.1 * r[2])


def test_the_two_variances_add_up_to_the_trace():
    parts = value("radial_sd@2") ** 2 + value("tangential_sd@2") ** 2
    np.testing.assert_allclose(parts, np.einsum("iim->m", COV[1]))


def test_principal_axes_are_those_of_the_covariance():
    least, largest = (value(f"principal_sd(which={which})@2") for which in ("least", "largest"))
    w = np.linalg.eigvalsh(np.moveaxis(COV[1], -1, 0)).T
    np.testing.assert_allclose([least**2, largest**2], w, rtol=1e-12)
    np.testing.assert_allclose(value("principal_sd[px]@2") ** 2, COV[1, 0, 0])


def test_excess_is_what_is_stated_minus_what_happened():
    error = MEAN - TRUTH
    np.testing.assert_allclose(value("excess@4"), np.einsum("iim->m", COV[3]) - (error[3] ** 2).sum(0))
    parts = value("excess(along=radial)@4") + value("excess(along=tangential)@4")
    np.testing.assert_allclose(parts, value("excess@4"))
    u = TRUTH[3] / np.hypot(*TRUTH[3])
    across = np.stack([-u[1], u[0]])
    expected = np.einsum("im,ijm,jm->m", across, COV[3], across) - (across * error[3]).sum(0) ** 2
    np.testing.assert_allclose(value("excess(along=tangential)@4"), expected)


def test_indefinite_counts_updates_without_a_positive_definite_covariance():
    cov = COV.copy()
    cov[1, 0, 0, 2] = -1.0
    np.testing.assert_allclose(value("indefinite", cov=cov), [0, 0, 1 / T, 0, 0])


def test_a_run_crosses_the_cut_where_its_bearing_jumps():
    truth = np.full((T, 2, RUNS), [[-3.0], [1.0]])
    truth[3:, 1, 1] = -1.0  # across the negative axis
    truth[3:, 0, 2] = 3.0  # to the other side, not across the cut
    np.testing.assert_array_equal(value("crossed", truth=truth), [0, 1, 0, 0, 0])


def test_the_score_is_what_the_scenario_says():
    np.testing.assert_array_equal(value("score"), value("rmse"))
    np.testing.assert_array_equal(value("score", score="axis_rmse[py]"), value("axis_rmse[py]"))


@pytest.mark.parametrize("text", ["rmse@k", "nees", "pooled_rmse", "score", "rmes"])
def test_a_score_that_is_not_one_number_of_the_estimates_is_refused(text):
    with pytest.raises(SpecError) as caught:
        Experiment.of({**SPECS["navigation"], "score": text})
    assert caught.value.path[0] == "score"


def test_entries_of_the_excess_make_up_the_matrix_of_which_excess_is_the_trace():
    error = MEAN - TRUTH
    np.testing.assert_allclose(value("excess_entry[px,py]@3"), COV[2, 0, 1] - error[2, 0] * error[2, 1])
    diagonal = value("excess_entry[px,px]@3") + value("excess_entry[py,py]@3")
    np.testing.assert_allclose(diagonal, value("excess@3"))
    for text in ("excess_entry@3", "excess_entry[px]@3"):
        with pytest.raises(SpecError, match="needs two states, or one named twice"):
            value(text)
