"""One run from the inside: its numbers are those of the study."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rkfbench.cli.commands import app
from rkfbench.errors import UsageError
from rkfbench.experiment import Experiment
from rkfbench.scenario import load
from rkfbench.scenario.pick import filter_of
from rkfbench.store import Results, files
from rkfbench.streams import GROUP, Streams
from rkfbench.study.tune import Bench
from rkfbench.trace import trace, worst
from tests.test_recording import EXAMPLE, SCENARIO


def rkfbench(*args: str | Path) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def cell_of(path: Path, case: str = "rate=0.4") -> Any:
    return next(cell for cell in load(path).cells if cell.case == case)


def test_columns_are_those_of_the_study(small: Path) -> None:
    cell = cell_of(small)
    experiment = Experiment.of(cell.spec)
    world = experiment.simulate(Streams(5, 1))  # run 133 is run 5 of the second group
    filt, told = experiment.filters["hkf"]
    estimate = filt.run(
        experiment.model, world.y, world.x0, told.P0, Q=told.Q, R=told.R, keep=("cov", "nu", "S", "inflation")
    )
    columns = trace(cell, 5, 133, "hkf").columns
    for prefix, names, values in (
        ("x", experiment.model.states, world.x),
        ("xhat", experiment.model.states, estimate.mean),
        ("y", experiment.model.measurements, world.y),
        ("nu", experiment.model.measurements, estimate.extras["nu"]),
        ("inflation", experiment.model.measurements, estimate.extras["inflation"]),
    ):
        for i, name in enumerate(names):
            np.testing.assert_array_equal(columns[f"{prefix}_{name}"], values[:, i, 5])
    assert estimate.cov is not None
    np.testing.assert_array_equal(columns["sd_vy"], np.sqrt(estimate.cov[:, 3, 3, 5]))
    np.testing.assert_array_equal(columns["S_px_vx"], estimate.extras["S"][:, 0, 2, 5])
    np.testing.assert_array_equal(columns["outlier"], world.v.flags[:, 5])
    np.testing.assert_array_equal(columns["t"], 0.5 * columns["k"])
    assert not columns["failed"].any()


def test_the_command_writes_a_table_and_a_figure(small: Path) -> None:
    result = rkfbench("trace", small, "--filter", "hkf", "--run", "3", "--case", "rate=0.4")
    assert result.exit_code == 0, result.stderr
    paths = [Path(line) for line in result.stdout.splitlines()]
    assert [path.name for path in paths] == [f"rate=0.4.hkf.run3.{suffix}" for suffix in ("csv", "png", "pdf")]
    assert all(path.parent == Path("results/small~trace") for path in paths)
    rows = files.read_records(paths[0])
    assert [row["k"] for row in rows] == list(range(1, 13))
    as_json = json.loads(
        rkfbench("trace", small, "--filter", "hkf", "--run", "3", "--case", "rate=0.4", "--json").stdout
    )
    assert as_json == rows


def test_traces_of_other_options_stand_in_other_places(small: Path) -> None:
    traced = ("trace", small, "--filter", "hkf", "--case", "rate=0", "--run", "3")
    first, second = (Path(rkfbench(*traced, *more).stdout.split()[0]) for more in ([], ["--seed", "9"]))
    assert (str(first.parent), str(second.parent)) == ("results/small~trace", "results/small~trace,seed=9")
    before = first.read_bytes()
    assert before != second.read_bytes()
    refused = rkfbench(*traced, "--seed", "9", "--out", first.parent)
    assert (refused.exit_code, "is of other options (small trace)" in refused.stderr) == (2, True)
    first.write_text("mine")
    assert rkfbench(*traced).exit_code == 2
    assert first.read_text() == "mine"
    beyond = rkfbench(*traced, "--runs", "3")
    assert (beyond.exit_code, "--run is 0 to 2" in beyond.stderr) == (2, True)


@pytest.mark.parametrize("stored", [True, False])
def test_the_worst_run_is_that_of_the_study(small: Path, stored: bool) -> None:
    assert rkfbench("run", small, "-q", "--out", "results/small" if stored else "elsewhere").exit_code == 0
    results = Results.open("results/small" if stored else "elsewhere")
    values = results.values("default", "rate=0.4", "hkf", "err_norm")
    run, value = worst(load(small), cell_of(small), "hkf", "err_norm", Path("results/small"))
    assert (run, value) == (int(np.argmax(values)), values.max())


def test_stored_numbers_are_read_and_not_computed_again(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rkfbench("run", small, "-q")

    def never(*args: Any) -> Any:
        raise AssertionError

    monkeypatch.setattr("rkfbench.study.compute.compute", never)
    folder = Path("results/small")
    assert worst(load(small), cell_of(small), "hkf", "err_norm", folder)[1] > 0
    with pytest.raises(AssertionError):  # another seed has other numbers
        worst(load(small, seed=6), cell_of(small), "hkf", "err_norm", folder)
    with pytest.raises(AssertionError):  # not among the metrics of the study
        worst(load(small), cell_of(small), "hkf", "rmse", folder)


def test_the_worst_run_is_the_least_likely_one(small: Path) -> None:
    cell = cell_of(small)
    scenario = load(small)
    score = Bench(cell.spec, filter_of(cell, "hkf"), "log_likelihood", scenario.seed, scenario.runs)([{}])[0]
    run, value = worst(load(small), cell, "hkf", "log_likelihood", Path("results/small"))
    assert (run, value) == (int(np.argmin(score.values)), score.values.min())


def test_a_failed_run_is_the_worst(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from rkfbench.study import compute as module

    compute = module.compute

    def failing(*args: Any) -> Any:
        result = compute(*args)
        for each in result.filters.values():
            each.failed[2] = True
            each.values["rmse"][2] = np.nan
        return result

    monkeypatch.setattr(module, "compute", failing)
    assert worst(load(small), cell_of(small), "hkf", "rmse", Path("results/small")) == (2, np.inf)


def test_the_worst_run_is_said(small: Path) -> None:
    result = rkfbench("trace", small, "--filter", "kf", "--worst", "--case", "rate=0")
    run, value = worst(load(small), cell_of(small, "rate=0"), "kf", "rmse", Path("results/small"))
    assert result.stderr.startswith(f"run {run} of 6: rmse = {value:.6g}\n")
    assert f"run{run}.csv" in result.stdout


def test_recorded_data_has_times_gaps_and_perhaps_no_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    spec = load(EXAMPLE, sets=["data.truth=null", "metrics=[nis]", "tables=[]"]).cells[0]
    columns = trace(spec, 0, 1, "kf").columns
    assert "x_px" not in columns and "outlier" not in columns
    assert columns["t"][3] == 2.5
    assert np.isnan(columns["y_px"][20:23]).all() and np.isnan(columns["nu_px"][20:23]).all()
    result = rkfbench("trace", EXAMPLE, "--filter", "hkf", "--worst")
    assert result.exit_code == 0, result.stderr
    rows = files.read_records(Path(result.stdout.split()[0]))
    assert rows[20]["y_px"] is None and rows[20]["x_px"] is not None


@pytest.mark.parametrize("scenario", ["navigation", "ungm", "odometers", "falling-body", "altitude-tracking"])
def test_every_filter_of_a_bundled_scenario_can_be_traced_or_says_why_not(scenario: str) -> None:
    loaded = load(scenario)
    cell = loaded.cells[0]
    experiment = Experiment.of(cell.spec)
    labels = [each["label"] for each in cell.spec["filters"] if not each.get("extra")]
    for label in labels[:6]:
        if getattr(experiment.filters[label][0], "target", None) is None:
            found = trace(cell, loaded.seed, 2, label)
            assert {len(column) for column in found.columns.values()} == {cell.spec["steps"]}
        else:
            with pytest.raises(UsageError, match="estimates one step only"):
                trace(cell, loaded.seed, 2, label)


def test_a_recording_that_is_not_there_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = rkfbench("trace", EXAMPLE, "--filter", "kf", "--run", "2")
    assert (result.exit_code, result.stdout, list(tmp_path.iterdir())) == (2, "", [])
    assert "run 2: the data has 2 recordings, so --run is 0 to 1" in result.stderr


def test_the_times_of_a_recording_are_its_own_beyond_the_first_group_of_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    rows = [f"{run:03d},{0.5 * k + run},{k},{k}" for run in range(GROUP + 3) for k in range(1, 4)]
    Path("drive.csv").write_text("\n".join(["run,t,px,py", *rows]) + "\n")
    Path("drive.yaml").write_text(SCENARIO)
    (cell,) = load("drive.yaml").cells
    assert trace(cell, 0, GROUP + 2, "kf").columns["t"].tolist() == [GROUP + 2 + 0.5 * k for k in range(1, 4)]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--run", "1"], "which case? add --case and one of: rate=0, rate=0.4"),
        (["--case", "rate=0"], "which run? give either --run N or --worst"),
        (["--case", "rate=0", "--run", "1", "--worst"], "which run?"),
        (["--case", "rate=1", "--run", "1"], "has no case 'rate=1'"),
        (["--case", "rate=0", "--worst", "--metric", "err_norm@k"], "is not one number a run"),
    ],
)
def test_what_cannot_be_traced_is_said(small: Path, options: list[str], told: str) -> None:
    result = rkfbench("trace", small, "--filter", "hkf", *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert told in result.stderr


def test_an_unknown_filter_is_said(small: Path) -> None:
    result = rkfbench("trace", small, "--filter", "hfk", "--run", "0", "--case", "rate=0")
    assert result.exit_code == 2
    assert "no filter 'hfk' (did you mean 'hkf'?)" in result.stderr
