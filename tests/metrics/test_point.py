"""Metrics about a point: the same names for filters and smoothers, lags, runs that are lost, improvements."""

from __future__ import annotations

import numpy as np
import pytest

from rkfbench import metrics
from rkfbench.errors import SpecError
from rkfbench.experiment import Experiment
from rkfbench.filters import build
from rkfbench.study.compute import compute

NAMES = [
    *(
        "mse[px]@j",
        "mse_prior[px]@j",
        "mse[px]@j+0",
        "mse[px]@j+3",
        "mse[px]@lag",
        "tracking_mse[px]@j",
        "kept_mse[px]@j",
        "mse[px]",
    ),
    *("improvement@j", "improvement(base=post)@lag", "trace@j", "trace(of=prior_cov)@j", "distinct@lag"),
]
SPEC = {
    "steps": 40,
    "point": {"at": 12, "lag": 6},
    "model": {"kind": "navigation"},
    "start": {"truth": [1, 1, 0, 0]},
    "process_noise": {"kind": "gaussian", "cov": 0.1},
    "measurement_noise": {"kind": "gaussian", "cov": 2},
    "disturbances": [
        {"kind": "shots", "label": "w", "channel": "process", "window": [0, 12], "count": 1},
        {"kind": "shots", "label": "v", "channel": "measurement", "window": [0, 12], "count": 1},
    ],
    "assumed": {"mean": [1, 1, 0, 0], "cov": [4, 4, 3, 3]},
    "lost": {"states": ["px", "py"], "limit": 4, "at": 12},
    "filters": [
        {"label": "kf", "use": "kf"},
        {"label": "ks", "use": "ks"},
        {"label": "ps", "use": "ps", "particles": 40},
        {"label": "pf", "use": "pf", "particles": 40},
    ],
    "metrics": NAMES,
}


def changed(**changes):
    return {**SPEC, **changes}


def results(runs=100):
    return compute(SPEC, 3, 0, runs, [each["label"] for each in SPEC["filters"]]).filters


def test_a_smoother_and_its_filter_answer_to_the_same_names():
    found = results()
    kf, ks = found["kf"], found["ks"]
    np.testing.assert_allclose(ks.values["mse[px]@j+0"], kf.values["mse[px]@j"], rtol=1e-9)
    np.testing.assert_allclose(ks.values["mse_prior[px]@j"], kf.values["mse_prior[px]@j"], rtol=1e-9)
    assert ks.values["mse[px]@j"].mean() < kf.values["mse[px]@j"].mean() < kf.values["mse_prior[px]@j"].mean()
    np.testing.assert_array_equal(ks.lost, kf.lost)
    assert 0 < ks.lost.sum() < 100


def test_the_lag_runs_from_the_posterior_to_the_last_estimate():
    ks = results()["ks"]
    curve = ks.curves["mse[px]@lag"]
    assert len(curve) == 7
    np.testing.assert_array_equal(curve[0], ks.values["mse[px]@j+0"])
    np.testing.assert_array_equal(curve[3], ks.values["mse[px]@j+3"])
    np.testing.assert_array_equal(curve[-1], ks.values["mse[px]@j"])


def test_what_is_not_about_the_point_is_no_metric_of_a_smoother():
    found = results()
    assert "mse[px]" in found["kf"].values
    assert "mse[px]" not in found["ks"].values
    assert "mse[px]@lag" not in found["kf"].curves
    assert "improvement@j" not in found["kf"].values
    assert "distinct@lag" in found["ps"].curves
    assert "distinct@lag" not in found["ks"].curves


def test_lost_runs_leave_the_tracking_error_and_nothing_else():
    kf = results()["kf"]
    assert np.isnan(kf.values["tracking_mse[px]@j"]).tolist() == kf.lost.tolist()
    kept = ~kf.lost
    np.testing.assert_array_equal(kf.values["tracking_mse[px]@j"][kept], kf.values["mse[px]@j"][kept])
    np.testing.assert_array_equal(kf.values["kept_mse[px]@j"], np.where(kept, kf.values["mse[px]@j"], 0.0))


def test_improvements_are_those_of_the_stated_covariances():
    ks = results()["ks"]
    smoother = build("ks", at=12, lag=6)
    experiment = Experiment.of(SPEC)
    y = np.zeros((40, 2, 1))
    told = experiment.told
    own = smoother.run(experiment.model, y, told.mean, told.P0, Q=told.Q, R=told.R)
    before, after = (np.trace(P[..., 0]) for P in (own.extras["prior_cov"][0], own.cov[-1]))
    np.testing.assert_allclose(ks.values["improvement@j"], 100 * (1 - after / before), rtol=1e-10)
    np.testing.assert_allclose(ks.values["trace@j"], after, rtol=1e-10)
    np.testing.assert_allclose(ks.values["trace(of=prior_cov)@j"], before, rtol=1e-10)
    assert abs(ks.curves["improvement(base=post)@lag"][0]).max() < 1e-9


def test_a_filter_that_comes_along_has_the_numbers_it_has_alone():
    together = results()["pf"]
    alone = compute(SPEC, 3, 0, 100, ["pf"]).filters["pf"]
    for name, value in alone.values.items():
        np.testing.assert_array_equal(together.values[name], value)
    assert list(compute(SPEC, 3, 0, 10, ["pf", "ps", "kf"]).filters) == ["pf", "ps", "kf"]


def test_shots_do_not_depend_on_the_other_channel():
    """A case without process shots has the measurement shots of the case with both."""
    both = Experiment.of(SPEC)
    one = Experiment.of(changed(disturbances=SPEC["disturbances"][1:]))
    from rkfbench.streams import Streams

    np.testing.assert_array_equal(both.simulate(Streams(1)).v.value, one.simulate(Streams(1)).v.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"point": None}, "there is no `point` here"),
        ({"point": {"at": 41, "lag": 0}}, "step 41 is not within"),
        ({"point": {"at": 12, "lag": 30}}, "beyond the last step"),
        ({"metrics": ["mse@j+7"]}, "lag goes from 0 to 6"),
        (
            {"filters": [{"label": "s", "fixed_point": {"filter": "kf", "at": 39, "lag": 6}}]},
            "filters.0.fixed_point.lag",
        ),
        ({"filters": [{"label": "s", "fixed_point": {"filter": {"use": "mckf", "sigma": 0}}}]}, "filter.sigma"),
        (
            {"measurement_noise": {"kind": "gaussian", "cov": 0}, "assumed": {**SPEC["assumed"], "measurement_cov": 1}},
            "no density",
        ),
    ],
)
def test_bad_points_are_said_with_their_place(changes, message):
    with pytest.raises(SpecError, match=message):
        Experiment.of(changed(**changes))


def test_names_of_points_are_read():
    assert metrics.get("mse@j").point == "last"
    assert metrics.get("mse@j+5").point == 5
    assert metrics.get("mse@lag").curve
    with pytest.raises(SpecError, match="is not a metric"):
        metrics.get("mse@j-5")


def test_the_clairvoyant_filter_knows_the_shots():
    """It follows the mean of the shots and their covariance, in both channels, and has the least error by far."""
    spec = changed(
        filters=[{"label": "c", "use": "clairvoyant_kf"}, {"label": "kf", "use": "kf"}], metrics=["mse[px]@j"]
    )
    found = compute(spec, 3, 0, 100, ["c", "kf"]).filters
    assert found["c"].values["mse[px]@j"].mean() < 0.7 * found["kf"].values["mse[px]@j"].mean()
