"""Recorded data: what a scenario with `data` gives, and where in a CSV file a fault is told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rkfbench import recording
from rkfbench.cli.commands import app
from rkfbench.errors import InputChanged, ScenarioError, SpecError, UsageError
from rkfbench.experiment import Experiment
from rkfbench.scenario import load
from rkfbench.store import Results, files
from rkfbench.streams import Streams
from rkfbench.study import engines, plan
from rkfbench.study.jobs import Job
from rkfbench.study.run import run_study
from rkfbench.study.wide import alone

EXAMPLE = Path(__file__).parent / "data/drive.yaml"
SCENARIO = """\
name: drive
data: {measurements: drive.csv, time: t}
model: {kind: navigation, dt: 0.5, observed: [px, py]}
assumed: {mean: [0, 0, 1, 1], cov: 1, process_cov: 0.1, measurement_cov: 1}
filters: [kf, hkf]
metrics: [nis, whiteness]
"""
ROWS = ["t,px,py", "0.5,1,2", "1.0,1.5,", "1.5,,", "2.0,3,nan", "2.5,3,4"]


@pytest.fixture
def drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario with one recording, in a current directory of its own."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.csv").write_text("\n".join(ROWS) + "\n")
    path = tmp_path / "drive.yaml"
    path.write_text(SCENARIO)
    return path


def rkfbench(*args: str | Path) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def problems(path: Path, **options: Any) -> list[str]:
    with pytest.raises(ScenarioError) as error:
        load(path, **options)
    return [problem.render().split("\n")[0] for problem in error.value.problems]


def csv(path: Path, *rows: str) -> None:
    path.with_suffix(".csv").write_text("\n".join(rows) + "\n")


def test_an_empty_cell_and_nan_are_missing_components(drive: Path) -> None:
    found = recording.read({"measurements": "drive.csv", "time": "t"}, ["px", "py"], [])
    assert found.y.shape == (5, 2, 1)
    np.testing.assert_array_equal(found.y[..., 0], [[1, 2], [1.5, np.nan], [np.nan, np.nan], [3, np.nan], [3, 4]])
    np.testing.assert_array_equal(found.intervals, np.full((4, 1), 0.5))


def test_steps_and_runs_are_those_of_the_recording(drive: Path) -> None:
    scenario = load(drive)
    assert (scenario.runs, scenario.reference_runs, scenario.cells[0].spec["steps"]) == (1, 1, 5)
    assert load(drive, sets=["steps=3"]).cells[0].spec["steps"] == 3
    assert problems(drive, sets=["steps=6"]) == ["--set steps=6: steps: the recording has 5 steps"]
    assert problems(drive, runs=2) == ["--runs 2: runs: only 1 recording is there"]


def test_rows_of_several_runs(drive: Path) -> None:
    csv(drive, "run,t,px,py", "a,0.5,1,2", "a,1,3,4", "b,7,5,6", "b,7.5,7,8")
    scenario = load(drive)
    world = Experiment.of(scenario.cells[0].spec).simulate(Streams(0))
    assert scenario.runs == 2
    np.testing.assert_array_equal(world.y[:, 0, :4], [[1, 5, 1, 5], [3, 7, 3, 7]])


def test_a_recording_of_a_simulation_gives_the_numbers_of_the_simulation(small: Path) -> None:
    assert rkfbench("run", small, "-q").exit_code == 0
    assert rkfbench("export", small, "-q", "--out", "ex").exit_code == 0
    text = small.read_text()
    told = "data: {measurements: ex/rate=0.measurements.csv, truth: ex/rate=0.truth.csv}\n"
    kept = [line for line in text.splitlines() if line.split(":")[0] in ("model", "filters", "metrics", "seed")]
    assumed = "assumed: {mean: [0, 0, 0, 0], cov: 1, process_cov: 1, measurement_cov: 1}"
    Path("recorded.yaml").write_text("\n".join(["name: recorded", told, assumed, *kept]) + "\n")
    assert rkfbench("run", "recorded.yaml", "-q").exit_code == 0
    ours, theirs = Results.open("results/recorded"), Results.open("results/small")
    for label in ("kf", "hkf"):
        for metric in ("err_norm", "pooled_rmse"):
            recorded = ours.values("default", "", label, metric)
            assert len(recorded) == 6
            np.testing.assert_array_equal(recorded, theirs.values("default", "rate=0", label, metric))


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["t,px,pz", "1,2,3"], "drive.csv:1:1: no column 'py', which the model measures (there are t, px, pz)"),
        (
            ["time,px,py", "1,2,3"],
            "drive.csv:1:1: no column 't', which the scenario names as `time` (there are time, px, py)",
        ),
        (["t,px,py", "0.5,1,2", "1.0,1,two"], "drive.csv:3:7: py: 'two' is no finite number"),
        (["t,px,py", "0.5,1,2", "1.0,1,inf"], "drive.csv:3:7: py: 'inf' is no finite number"),
        (["t,px,py", "0.5,1,2", "0.5,1,2"], "drive.csv:3:1: t: the time does not increase: 0.5 after 0.5"),
        (["t,px,py", "0.5,1,2", ",1,2"], "drive.csv:3:1: t: the time is missing"),
        (["t,px,py", "0.5,1,2", "1,1"], "drive.csv:3:1: 2 cells, the header has 3"),
        (["t,px,px", "0.5,1,2"], "drive.csv:1:1: two columns are called 'px'"),
        (["t;px;py", "0.5;1;2"], "drive.csv:1:1: the cells must be separated by commas"),
        (
            ["run,t,px,py", "a,1,1,1", "a,2,1,1", "b,1,1,1"],
            "drive.csv:4:1: run: run b has 1 steps, run a has 2: fill what is missing with rows of empty cells",
        ),
        (
            ["run,t,px,py", "a,1,1,1", "b,1,1,1", "a,2,1,1"],
            "drive.csv:4:1: run a stands in two places: its rows must follow each other",
        ),
    ],
)
def test_a_fault_of_a_recording_is_told_with_its_place(drive: Path, rows: list[str], told: str) -> None:
    csv(drive, *rows)
    assert problems(drive) == [told]
    result = rkfbench("run", drive)
    assert (result.exit_code, result.stdout) == (2, "")
    assert told in result.stderr


def test_all_faults_of_a_recording_are_told_at_once(drive: Path) -> None:
    csv(drive, "t,px,py", "0.5,one,2", "0.4,1,2", "1,1,two")
    assert [line.split(" ")[0] for line in problems(drive)] == ["drive.csv:2:5:", "drive.csv:4:5:", "drive.csv:3:1:"]
    csv(drive, "t,px,py", *(f"{k},x,1" for k in range(40)))
    assert problems(drive)[-1] == "drive.csv: and more of the kind"


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (["t,px,py,vx", *["1,1,1,1"] * 5], "truth.csv:1:1: no column 'vy', which the model has as a state"),
        (["px,py,vx,vy", *["1,1,1,1"] * 4], "truth.csv:5:1: 4 steps, drive.csv has 5"),
        (["px,py,vx,vy", *["1,1,1,1"] * 4, "1,1,1,"], "truth.csv:6:7: vy: the truth is missing"),
        (
            ["t,px,py,vx,vy", *(f"{t},1,1,1,1" for t in (0.5, 1, 1.5, 2, 3))],
            "truth.csv:6:1: t: not the time of drive.csv, 2.5",
        ),
    ],
)
def test_a_truth_that_does_not_fit_is_told_with_its_place(drive: Path, rows: list[str], told: str) -> None:
    Path("truth.csv").write_text("\n".join(rows) + "\n")
    assert problems(drive, sets=["data.truth=truth.csv"])[0].startswith(told)


def test_a_file_that_is_not_there_is_told_where_the_scenario_names_it(drive: Path) -> None:
    (drive.parent / "drive.csv").unlink()
    (told,) = problems(drive)
    assert told.startswith("drive.yaml:2:22: data.measurements: there is no file ")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("dt: 0.5", "dt: 0.1", "data.time: the recorded time advances by 0.5, but the model's dt is 0.1"),
        ("metrics: [nis", "metrics: [rmse", "metrics.0: 'rmse' needs the true states, which the recorded data does"),
        ("[kf, hkf]", "[clairvoyant_kf]", "filters.clairvoyant_kf: 'clairvoyant_kf' needs the record of the noise"),
        ("[kf, hkf]", "[truth]", "filters.truth: 'truth' needs the true states"),
        (", process_cov: 0.1", "", "assumed.process_cov: is required with recorded data"),
        (", measurement_cov: 1", "", "assumed.measurement_cov: is required with recorded data"),
        ("name: drive", "name: drive\nstart: {truth: [0, 0, 0, 0]}", "start: is for a simulation, and with `data`"),
        ("name: drive", "name: drive\nlost: {states: [px], limit: 1}", "lost: needs the true states"),
    ],
)
def test_what_recorded_data_cannot_give_is_said(drive: Path, old: str, new: str, told: str) -> None:
    drive.write_text(SCENARIO.replace(old, new))
    (only,) = problems(drive)
    assert told in only


def test_a_recording_without_any_measurement_is_told_where_the_scenario_names_it(drive: Path) -> None:
    csv(drive, "t,px,py", "0.5,,", "1.0,nan,", "1.5,1,2")
    load(drive)
    (told,) = problems(drive, sets=["steps=2"])
    assert "data.measurements: no measurement at all in 2 steps: every cell is empty" in told
    assert rkfbench("run", drive, "--set", "steps=2").exit_code == 2


def test_the_error_of_a_metric_names_those_that_need_no_truth(drive: Path) -> None:
    (told,) = problems(drive, sets=["metrics=[rmse]"])
    names = told.partition("(these do not: ")[2].rstrip(")").split(", ")
    assert {"nis", "whiteness", "mean_of", "log_likelihood"} <= set(names)
    assert not {"rmse", "nees", "score", "if_norm", "lambda_auc"} & set(names)


def test_without_data_a_simulation_needs_what_it_needs(small: Path) -> None:
    small.write_text("\n".join(line for line in small.read_text().splitlines() if not line.startswith("st")))
    assert [line.partition(": ")[2] for line in problems(small)] == ["steps: is required", "start: is required"]


IRREGULAR = ["t,px,py", "0.5,1,2", "1.0,1.5,2", "2.0,3,4", "2.5,3,5", "4.0,5,6"]
REGULAR = [*IRREGULAR[:3], "1.5,,", *IRREGULAR[3:5], "3.0,,", "3.5,,", "4.0,5,6"]


def estimated(path: Path, label: str, **options: Any) -> np.ndarray:
    spec = load(path, **options).cells[0].spec
    experiment = Experiment.of(spec)
    world = experiment.simulate(Streams(0))
    return alone(experiment, world, Streams(0), label, frozenset({"cov"})).mean[..., 0]


@pytest.mark.parametrize("label", ["kf", "hkf", "aladkf", "ekf", "ukf", "mckf", "ckf"])
def test_irregular_times_are_regular_ones_with_gaps_where_there_is_no_process_noise(drive: Path, label: str) -> None:
    options = {"sets": ["assumed.process_cov=0", f"filters=[{label}]"]}
    csv(drive, *IRREGULAR)
    irregular = estimated(drive, label, **options)
    csv(drive, *REGULAR)
    regular = estimated(drive, label, **options)
    np.testing.assert_allclose(irregular, regular[[0, 1, 3, 4, 7]], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("label", ["skf", "sdf", "raf", "daf"])
def test_adaptive_filters_follow_irregular_times(drive: Path, label: str) -> None:
    text = SCENARIO.replace("{kind: navigation, dt: 0.5, observed: [px, py]}", "{kind: odometers, dt: 0.5}")
    drive.write_text(text.replace("[0, 0, 1, 1]", "[0, 2]").replace("[kf, hkf]", f"[{label}]"))
    csv(drive, "t,A,B", *(f"{t},{2 * t + 0.1},{2 * t - 0.1}" for t in (0.5, 1, 2, 2.5, 4)))
    position, speed = estimated(drive, label).T
    np.testing.assert_allclose(position, [1, 2, 4, 5, 8], atol=0.05)
    np.testing.assert_allclose(speed, 2, atol=0.05)


def test_irregular_steps_get_their_own_F_and_Q_in_proportion(drive: Path) -> None:
    csv(drive, *IRREGULAR)
    x, P, before = np.array([0.0, 0, 1, 1]), np.eye(4), 0.0
    expected = []
    for row in IRREGULAR[1:]:
        t, *y = map(float, row.split(","))
        F = np.kron([[1, t - before], [0, 1]], np.eye(2))
        H = np.eye(4)[:2]
        x, P = F @ x, F @ P @ F.T + 0.1 * np.eye(4) * (t - before) / 0.5
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.eye(2))
        x, P, before = x + K @ (y - H @ x), (np.eye(4) - K @ H) @ P, t
        expected.append(x)
    np.testing.assert_allclose(estimated(drive, "kf"), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("dt: 0.5", "dt: 2", "advances by 0.5 to 1.5, but the model's dt, for which Q is told, is 2"),
        ("[kf, hkf]", "[pf]", "'pf' needs equal time steps"),
        (
            "{kind: navigation, dt: 0.5, observed: [px, py]}",
            "{kind: range_bearing}",
            "this model has no dt to follow it",
        ),
        (
            "[kf, hkf]",
            "[{decoupled: {filter: kf, parts: [[px, vx], [py, vy]]}, label: d}]",
            "constant matrices F and H",
        ),
    ],
)
def test_what_cannot_follow_irregular_times_is_said(drive: Path, old: str, new: str, told: str) -> None:
    text = SCENARIO.replace(old, new)
    if "range_bearing" in new:
        text = text.replace("[0, 0, 1, 1]", "[1, 1]").replace("[kf, hkf]", "[ekf]")
        csv(drive, IRREGULAR[0].replace("px", "range").replace("py", "bearing"), *IRREGULAR[1:])
    else:
        csv(drive, *IRREGULAR)
    drive.write_text(text)
    (only,) = problems(drive)
    assert told in only


def test_runs_with_different_irregular_times_are_refused(drive: Path) -> None:
    csv(drive, "run,t,px,py", *(f"a,{t},1,1" for t in (1, 2, 4)), *(f"b,{t},1,1" for t in (1, 3, 4)))
    assert "the runs have different irregular times" in problems(drive, sets=["model.dt=1"])[0]


def test_changed_data_is_computed_again_and_a_moved_file_is_not(drive: Path) -> None:
    assert rkfbench("run", drive).exit_code == 0
    (before,) = load(drive).cells
    keys = plan.part_keys(before.spec, 0)
    Path("moved").mkdir()
    for name in ("drive.csv", "drive.yaml"):
        Path(name).rename(Path("moved") / name)
    (moved,) = load("moved/drive.yaml").cells
    assert plan.part_keys(moved.spec, 0) == keys
    Path("moved/drive.csv").write_text("\n".join([*ROWS, "3.0,5,5"]) + "\n")
    result = rkfbench("run", "moved/drive.yaml", "--set", "steps=5", "--out", "results/drive")
    assert "recomputing the only case (default): recorded data changed" in result.stderr


def changing(path: Path) -> Any:
    """An engine that writes the file anew when the first job is done."""

    def engine(jobs: Any) -> Any:
        for job in jobs:
            yield from engines.serial([job])
            path.write_text("\n".join([*ROWS[:-1], "2.5,9,9"]) + "\n")

    return engine


def test_data_that_changes_while_a_study_runs_ends_it_and_what_is_finished_is_kept(drive: Path) -> None:
    drive.write_text(SCENARIO + "readings: {a: {}, b: {assumed.cov: 2}}\n")
    with pytest.raises(InputChanged, match=r"^drive\.csv was changed while the study ran: run the same command again"):
        run_study(load(drive), Path("r"), engine=changing(Path("drive.csv")))
    assert not Path("r/summary.csv").exists()
    csv(drive, *ROWS)
    assert run_study(load(drive), Path("r")).computed == 1


def test_a_copy_is_of_the_data_that_made_the_numbers(drive: Path) -> None:
    run_study(load(drive), Path("r"))
    before = Path("r/summary.csv").read_bytes()
    csv(drive, *ROWS[:-1], "2.5,3,5")
    with pytest.raises(InputChanged):
        run_study(load(drive), Path("r"), engine=changing(Path("drive.csv")))
    assert Path("r/summary.csv").read_bytes() == before
    Path("drive.csv").unlink()
    assert run_study(load("r/scenario.yaml"), Path("r")).computed == 1  # the old data is there


@pytest.mark.parametrize("row", ["2.5,9,9", "2.5,nine,9"])
def test_a_job_refuses_other_data_than_the_study_began_with(drive: Path, row: str) -> None:
    (cell,) = load(drive).cells
    csv(drive, *ROWS[:-1], row)
    with pytest.raises(InputChanged):
        Experiment.of(cell.spec)
    with pytest.raises(InputChanged):
        list(engines.serial([Job((0,), (cell.spec,), 0, 0, 1, ("kf",))]))
    (drive.parent / "drive.csv").unlink()
    with pytest.raises(InputChanged):
        Experiment.of(cell.spec)


def test_copies_of_files_that_are_named_no_more_go_away(drive: Path) -> None:
    Path("other.csv").write_text("\n".join(ROWS) + "\n")
    run_study(load(drive), Path("r"))
    run_study(load(drive, sets=["data.measurements=other.csv"]), Path("r"))
    assert [path.name for path in Path("r/data").iterdir()] == ["other.csv"]


def test_recordings_that_a_sweep_lists_are_called_as_they_are_written(drive: Path) -> None:
    Path("deep").mkdir()
    Path("deep/other.csv").write_text("\n".join(ROWS[:-1]) + "\n")
    drive.write_text(SCENARIO + "sweep: {data.measurements: {values: [drive.csv], extra: [deep/other.csv]}}\n")
    run_study(load(drive), Path("r"), full=True)
    cases = ["measurements=drive.csv", "measurements=deep/other.csv"]
    assert [cell.case for cell in load(drive).cells] == cases
    assert run_study(load("r/scenario.yaml"), Path("r"), full=True).computed == 0


def test_a_results_folder_stands_alone(drive: Path) -> None:
    assert rkfbench("run", drive, "-q").exit_code == 0
    (drive.parent / "drive.csv").unlink()
    assert "data/drive.csv" in Results.open("results/drive").manifest["files"]
    assert rkfbench("report", "results/drive").exit_code == 0
    again = rkfbench("run", "results/drive/scenario.yaml")
    assert "nothing to compute, results/drive is up to date" in again.stderr


def test_data_edited_in_a_results_folder_is_computed_and_kept(drive: Path) -> None:
    assert rkfbench("run", drive, "-q").exit_code == 0
    data = Path("results/drive/data/drive.csv")
    data.write_text(edited := data.read_text().replace("2.5,3,4", "2.5,3,7"))
    result = rkfbench("run", "results/drive/scenario.yaml")
    assert result.exit_code == 0
    assert "recomputing the only case (default): recorded data changed" in result.stderr
    assert "making again" not in result.stderr
    assert data.read_text() == edited
    assert Results.open("results/drive").manifest["files"]["data/drive.csv"] == files.sha256(data)
    assert rkfbench("run", drive).exit_code == 0  # from the file itself the copy is made again
    assert data.read_text() == Path("drive.csv").read_text()


def test_cases_may_be_recordings(drive: Path) -> None:
    Path("other.csv").write_text("\n".join(ROWS[:-1]) + "\n")
    drive.write_text(SCENARIO + "cases: {one: {}, two: {data.measurements: other.csv}}\n")
    assert [cell.spec["steps"] for cell in load(drive).cells] == [5, 4]
    assert rkfbench("run", drive, "-q").exit_code == 0
    assert {path.name for path in Path("results/drive/data").iterdir()} == {"drive.csv", "other.csv"}
    assert rkfbench("validate", "results/drive/scenario.yaml").exit_code == 0


def test_the_example_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert rkfbench("run", EXAMPLE, "-q").exit_code == 0
    results = Results.open("results/drive")
    metrics = {row["metric"] for row in results.summary if row["filter"] == "kf"}
    assert metrics == {"rmse", "nis", "nis_beyond", "whiteness", "log_likelihood", "innovation_rms"}
    assert results.runs == 2
    assert all(row["mean"] is not None for row in results.summary), "a gap and missing components are no reason"
    (shown,) = {row["metric"] for row in results.summary} - metrics
    assert shown == "mean_of(name=inflation)"
    without = load(EXAMPLE, sets=["data.truth=null", "metrics=[nis]", "tables=[]"])
    assert np.isnan(Experiment.of(without.cells[0].spec).simulate(Streams(0)).x).all()


def test_a_best_filter_is_not_chosen_on_the_data_that_judge_it(drive: Path) -> None:
    result = rkfbench("tune", drive, "--filter", "hkf", "--over", "threshold=1:3", "--metric", "nis")
    assert result.exit_code == 2
    assert "recorded data has none" in result.stderr
    assert json.loads(rkfbench("validate", drive, "--json").stdout)[0]["valid"]


def test_a_model_of_irregular_times_has_no_constant_matrices(drive: Path) -> None:
    csv(drive, *IRREGULAR)
    experiment = Experiment.of(load(drive).cells[0].spec)
    with pytest.raises(SpecError, match="constant matrices"):
        _ = experiment.assumed_model.matrices
    with pytest.raises(UsageError, match="no such file"):
        recording.read({"measurements": "nowhere.csv"}, ["px"], [])


def test_an_infinite_time_step_is_refused(drive: Path) -> None:
    drive.write_text(SCENARIO.replace("dt: 0.5", "dt: .inf"))
    assert "drive.yaml:3:31: model.dt: a time step must be finite, not inf" in problems(drive)[0]
