"""Metrics that need no truth, against loops over single runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from rkfbench import metrics
from rkfbench.experiment import Experiment
from rkfbench.metrics import Trial
from rkfbench.streams import Streams
from rkfbench.study.compute import compute
from tests.contract import SPECS

MATCHED = {
    **SPECS["navigation"],
    "steps": 200,
    "measurement_noise": {"kind": "gaussian", "cov": [[1, 0.5, 0.3], [0.5, 2, 0.4], [0.3, 0.4, 1]]},
    "start": {"truth": {"mean": [0, 0, 0, 0], "cov": 1}},
    "assumed": {"mean": [0, 0, 0, 0], "cov": 1},
    "filters": [{"label": "kf", "use": "kf"}, {"label": "hkf", "use": "hkf"}],
}


def trial(label: str, missing: bool) -> Trial:
    """A filter on data with gaps: single components of some runs, one step without any measurement at all."""
    experiment = Experiment.of({**SPECS["navigation"], "filters": MATCHED["filters"]})
    world = experiment.simulate(Streams(3))
    if missing:
        world.y[2, 1] = np.nan
        world.y[3, 0, ::2] = np.nan
        world.y[5] = np.nan
        world.y[7, :, 1] = np.nan
    filt, told = experiment.filters[label]
    keep = ("nu", "S", "cov")
    estimate = filt.run(experiment.model, world.y, world.x0, told.P0, Q=told.Q, R=told.R, keep=keep)
    return Trial(experiment, world, filt, estimate)


def observed(trial: Trial, run: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """nu and S of the components measured, at the steps with any."""
    found = []
    for nu, S, y in zip(trial.estimate.extras["nu"], trial.estimate.extras["S"], trial.world.y, strict=True):
        rows = np.flatnonzero(~np.isnan(y[:, run]))
        if len(rows):
            found.append((nu[rows, run], S[np.ix_(rows, rows)][..., run if S.shape[-1] > 1 else 0]))
    return found


@pytest.mark.parametrize("missing", [False, True])
@pytest.mark.parametrize("label", ["kf", "hkf"])
def test_values_are_those_of_a_textbook_loop(label: str, missing: bool) -> None:
    of = trial(label, missing)
    got = {name: metrics.get(name)(of) for name in ("nis", "nis_beyond(level=0.9)", "log_likelihood", "innovation_rms")}
    for run in (0, 1, 2):
        pairs = observed(of, run)
        nis = [nu @ np.linalg.solve(S, nu) for nu, S in pairs]
        beyond = [value > stats.chi2.ppf(0.9, len(nu)) for value, (nu, _) in zip(nis, pairs, strict=True)]
        likelihood = [stats.multivariate_normal.logpdf(nu, cov=S) for nu, S in pairs]
        assert got["nis"][run] == pytest.approx(np.mean(nis))
        assert got["nis_beyond(level=0.9)"][run] == pytest.approx(np.mean(beyond))
        assert got["log_likelihood"][run] == pytest.approx(np.mean(likelihood))
        assert got["innovation_rms"][run] == pytest.approx(np.sqrt(np.mean([nu @ nu for nu, _ in pairs])))


def test_whiteness_is_the_autocorrelation_of_standardised_innovations() -> None:
    of = trial("hkf", missing=False)
    for lag in (1, 3):
        got = metrics.get(f"whiteness(lag={lag})")(of)
        e = np.array([np.linalg.solve(np.linalg.cholesky(S), nu) for nu, S in observed(of, 4)])
        assert got[4] == pytest.approx((e[lag:] * e[:-lag]).sum() / (e * e).sum())


def test_where_no_two_steps_are_that_far_apart_whiteness_is_not_a_number() -> None:
    of = trial("kf", missing=False)
    T = len(of.world.y)
    assert np.isfinite(metrics.get(f"whiteness(lag={T - 1})")(of)).all()
    for lag in (T, T + 1, 10 * T):
        assert np.isnan(metrics.get(f"whiteness(lag={lag})")(of)).all()
    of = trial("kf", missing=False)
    of.estimate.extras["nu"][::2, :, 0] = np.nan  # of the first run every second measurement is missing
    found = metrics.get("whiteness")(of)
    assert np.isnan(found[0]) and np.isfinite(found[1:]).all()


def test_one_component_and_the_curve() -> None:
    of = trial("kf", missing=True)
    nu = of.estimate.extras["nu"][:, 1]
    np.testing.assert_allclose(
        metrics.get("innovation_rms(component=py)")(of)[:3], np.sqrt(np.nanmean(nu * nu, axis=0))[:3]
    )
    curve = metrics.get("nis@k")(of)
    assert np.isnan(curve[5]).all() and np.isfinite(curve[4]).all()


def test_of_a_matched_kalman_filter_nis_is_chi_square_and_innovations_are_white() -> None:
    names = ["nis", "nis_beyond", "whiteness", "whiteness(lag=5)"]
    result = compute({**MATCHED, "metrics": names}, 11, 0, 400, ["kf"]).filters["kf"]
    for name, expected in zip(names, (3.0, 0.05, 0.0, 0.0), strict=True):
        values = result.values[name]
        assert abs(values.mean() - expected) < 4 * values.std() / np.sqrt(len(values)), name
