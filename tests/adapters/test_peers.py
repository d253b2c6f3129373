"""Filters of FilterPy and Stone Soup in a scenario, beside ours in one table: the same to 1e-9."""

import numpy as np
import pytest

from rkfbench import contract
from rkfbench.filters import build
from rkfbench.models import build as model_of
from rkfbench.store import Results
from tests.test_cli import rkfbench

LIBRARIES = ("filterpy", "stonesoup")

PEERS = """\
name: peers
seed: 2
runs: {paper: 8, reference: 8}
steps: 15
model: {kind: range_bearing}
start: {truth: [-100, 5]}
process_noise: {kind: gaussian, cov: 0.5}
measurement_noise: {kind: gaussian, cov: [0.5, 0.006]}
assumed: {mean: [-90, 10], cov: 50}
filters:
  - ekf
  - {use: rkfbench.adapters.filterpy:ekf, label: filterpy ekf}
  - {use: rkfbench.adapters.stonesoup:ekf, label: stonesoup ekf}
  - {use: ukf, alpha: 0.6, beta: 2, kappa: 1}
  - {use: rkfbench.adapters.filterpy:ukf, alpha: 0.6, beta: 2, kappa: 1, label: filterpy ukf}
  - {use: rkfbench.adapters.stonesoup:ukf, alpha: 0.6, beta: 2, kappa: 1, label: stonesoup ukf}
metrics: [rmse, nees]
tables: [{id: t, metric: rmse}]
"""


def test_one_table_with_theirs_and_ours(tmp_path, monkeypatch):
    """The bearing crosses its cut: what wraps is the model's residual, for all of them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "peers.yaml").write_text(PEERS)
    result = rkfbench("run", "peers.yaml")
    assert result.exit_code == 0, result.stderr
    assert "peers: stonesoup ukf takes the runs one by one: " in result.stderr
    stored = Results.open("results/peers")
    for ours in ("ekf", "ukf"):
        for theirs in LIBRARIES:
            for metric in ("rmse", "nees"):
                mine, other = (stored.values("default", "", label, metric) for label in (ours, f"{theirs} {ours}"))
                np.testing.assert_allclose(other, mine, rtol=1e-9)
    header = (tmp_path / "results/peers/tables/t.md").read_text().splitlines()[2]
    assert all(each in header for each in ("EKF", "filterpy ekf", "stonesoup ukf"))


@pytest.mark.parametrize("library", LIBRARIES)
def test_means_and_covariances_are_ours_with_missing_components_and_a_changing_model(library):
    """k enters f, and single components are missing."""
    rng = np.random.default_rng(3)
    told = {"x0": np.array([0.5]), "P0": np.eye(1), "Q": 10 * np.eye(1), "R": np.eye(1)}
    y = rng.normal(3, 2, (20, 1, 2))
    y[6] = np.nan
    cases = [(model_of({"kind": "ungm"}), y, told, ("ekf", "ukf"))]
    nav = model_of({"kind": "navigation", "dt": 0.5, "observed": ["px", "py", "vx"]})
    y = rng.normal(0, 3, (20, 3, 2))
    y[rng.random(y.shape) < 0.3] = np.nan
    told = {"x0": np.zeros(4), "P0": np.eye(4), "Q": np.eye(4), "R": np.diag([1.0, 2, 3]) + 0.2}
    cases.append((nav, y, told, ("kf", "ekf", "ukf")))
    for model, measured, known, names in cases:
        for name in names:
            ours = build(name).run(model, measured, **known)
            theirs = build(f"rkfbench.adapters.{library}:{name}").run(model, measured, **known)
            np.testing.assert_allclose(theirs.mean, ours.mean, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(theirs.cov, np.broadcast_to(ours.cov, theirs.cov.shape), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("name", ["kf", "ekf", "ukf"])
def test_covariances_that_change_with_time_and_innovations_are_ours(library, name):
    rng = np.random.default_rng(4)
    model = model_of({"kind": "range_bearing"} if name != "kf" else {"kind": "navigation", "observed": ["px", "vx"]})
    n, scale = len(model.states), 1 + np.arange(15)[:, None, None, None] % 3
    y = rng.normal(0, 0.1, (15, 2, 3)) + (model.h(np.full(n, 50.0), 1)[:, None] if name != "kf" else 0.0)
    y[rng.random(y.shape) < 0.2] = np.nan
    told = {"x0": np.full(n, 50.0 if name != "kf" else 0.0), "P0": np.eye(n)}
    told |= {"Q": 0.1 * np.eye(n)[None, ..., None] * scale, "R": np.diag([0.5, 0.006])[None, ..., None] * scale}
    keep = ("cov", "nu", "S")
    ours, theirs = (
        build(each).run(model, y, **told, keep=keep) for each in (name, f"rkfbench.adapters.{library}:{name}")
    )
    np.testing.assert_allclose(theirs.mean, ours.mean, rtol=1e-9, atol=1e-9)
    for each in ("nu", "S"):
        there = ~np.isnan(theirs.extras[each])
        expected = np.broadcast_to(ours.extras[each], there.shape)
        np.testing.assert_array_equal(there, ~np.isnan(expected))
        np.testing.assert_allclose(theirs.extras[each], expected, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("library", LIBRARIES)
@pytest.mark.parametrize("name", ["kf", "ekf", "ukf"])
def test_they_keep_the_contract(library, name):
    filt = build(f"rkfbench.adapters.{library}:{name}")
    served = [problem for problem in contract.problems() if problem.serves(filt)]
    assert len(served) == (2 if name == "kf" else 3)
    for check in contract.CHECKS:
        assert list(check(contract.Subject(filt, served[-1]))) == []
