"""Data for programs in other languages, and their estimates beside ours."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from rkfbench.cli.commands import app
from rkfbench.errors import InputChanged, ScenarioError
from rkfbench.experiment import Experiment
from rkfbench.scenario import load
from rkfbench.store import Results, files
from rkfbench.streams import Streams
from rkfbench.study.compute import compute
from rkfbench.study.run import run_study
from tests.conftest import SMALL
from tests.test_readme import block

SHOWN = """\
figures:
  - {id: errors, kind: curve, metric: err_norm@k, filters: [kf]}
tables:
  - {id: errors, metric: [err_norm, nees, pooled_rmse], filters: [kf, hkf]}
claims:
  - id: mine
    says: outliers cost
    evidence: ours
    ordering: {metric: err_norm, filters: kf, cases: [rate=0.4, rate=0], along: cases}
"""


@pytest.fixture
def shown(small: Path) -> Path:
    """The small scenario with a table, a figure and a claim."""
    small.write_text(SMALL.replace("pooled_rmse,", "pooled_rmse, nees,") + SHOWN)
    return small


def rkfbench(*args: str | Path) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def ok(*args: str | Path) -> str:
    result = rkfbench(*args)
    assert (result.exit_code, "Traceback" in result.stderr) == (0, False), result.stderr
    return str(result.stdout)


def test_export_writes_what_the_filters_of_the_study_see(small: Path) -> None:
    written = ok("export", small).split()
    assert written[0] == "results/small~export/export.json"
    assert all(Path(path).is_file() for path in written)
    index = json.loads(Path(written[0]).read_text())
    assert [case["case"] for case in index["cases"]] == ["rate=0", "rate=0.4"]
    for cell, case in zip(load(small).cells, index["cases"], strict=True):
        experiment = Experiment.of(cell.spec)
        world = experiment.simulate(Streams(5))
        mat = loadmat(f"results/small~export/{case['files']['mat']}")
        np.testing.assert_array_equal(mat["y"], world.y[..., :6])
        np.testing.assert_array_equal(mat["x"], world.x[..., :6])
        for name, expected in (("P0", experiment.told.P0), ("Q", experiment.told.Q), ("R", experiment.told.R)):
            np.testing.assert_array_equal(mat[name], expected)
            np.testing.assert_array_equal(case[name], expected)
        F, H, _ = experiment.model.matrices
        np.testing.assert_array_equal(mat["F"], F)
        np.testing.assert_array_equal(case["H"], H)
        assert [str(each[0]) for each in mat["measurements"].ravel()] == ["px", "py", "vx"]
        columns, rows = files.read_csv(Path("results/small~export") / case["files"]["measurements"])
        assert columns == ["run", "k", "px", "py", "vx"]
        table = np.array([[float(cell) for cell in row] for row in rows])
        np.testing.assert_array_equal(table[:, 2:].reshape(6, 12, 3).transpose(1, 2, 0), world.y[..., :6])
    assert index["cases"][0]["model"]["parameters"]["dt"] == {"value": 0.5, "meaning": "time step in s"}


def test_export_takes_cases_readings_and_options(small: Path) -> None:
    small.write_text(SMALL + "readings: {first: {}, second: {assumed.cov: 2}}\n")
    names = [Path(each).name for each in ok("export", small, "--case", "rate=0.4", "--runs", "2", "--out", "a").split()]
    assert names == ["export.json", "rate=0.4.measurements.csv", "rate=0.4.truth.csv", "rate=0.4.mat"]
    assert loadmat("a/rate=0.4.mat")["y"].shape == (12, 3, 2)
    assert "b/second.rate=0.mat" in json.loads(ok("export", small, "--reading", "second", "--out", "b", "--json"))
    for options in (["--case", "rate=0.5"], ["--reading", "third"], ["--filter", "kff"]):
        result = rkfbench("export", small, *options)
        assert (result.exit_code, result.stdout) == (2, "")


def test_estimates_of_an_earlier_export_go_away_and_nothing_else_does(small: Path) -> None:
    assert rkfbench("export", small, "--filter", "hkf", "--out", "e").exit_code == 0
    Path("e/notes.txt").write_text("mine")
    assert rkfbench("export", small, "--seed", "9", "--out", "e").exit_code == 0
    assert not Path("e/estimates.hkf.csv").exists()
    assert Path("e/notes.txt").read_text() == "mine"
    Path("e/estimates.kf.csv").write_text("mine")
    refused = rkfbench("export", small, "--filter", "kf", "--out", "e")
    assert (refused.exit_code, "e/estimates.kf.csv was not written by rkfbench" in refused.stderr) == (2, True)
    assert Path("e/estimates.kf.csv").read_text() == "mine"


def test_a_nonlinear_model_is_exported_without_constant_matrices(tmp_path: Path) -> None:
    ok("export", "range-bearing", "--runs", "2", "--out", tmp_path)
    case = json.loads((tmp_path / "export.json").read_text())["cases"][0]
    assert "F" not in case and case["model"]["angles"] == ["bearing"] and len(case["x0"]) == 2


def test_a_smoother_of_one_point_has_no_estimates_along_the_run(small: Path) -> None:
    smoothing = SMALL.replace("sweep:", "point: {at: 5, lag: 3}\nsweep:").replace("filters: [kf,", "filters: [kf, ks,")
    small.write_text(smoothing.replace("[err_norm, pooled_rmse, err_norm@k]", '[err_norm, "mse@j"]'))
    result = rkfbench("export", small, "--filter", "kf", "--filter", "ks", "--out", "ex")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "'ks' estimates one step only: export the filter inside it" in result.stderr
    assert not Path("ex").exists()
    ok("export", small, "--filter", "kf", "--out", "ex")


def test_scoring_our_own_estimates_gives_the_table_of_the_filter(shown: Path) -> None:
    ok("export", shown, "--filter", "kf", "--out", "ex", "-q")
    assert ok("score", shown, "ex/estimates.kf.csv", "--label", "mine") == "results/small~score\n"
    results = Results.open("results/small~score")
    rows = {(row["case"], row["filter"], row["metric"]): row for row in results.summary}
    assert {metric for _, label, metric in rows if label == "mine"} == {"err_norm", "pooled_rmse", "nees"}
    for (case, label, metric), row in rows.items():
        if label == "mine":
            assert {**row, "filter": "kf"} == rows[case, "kf", metric]
    table = files.read_records(Path("results/small~score/tables/errors.csv"))
    cells = {(row["filter"], row["case"], row["metric"]): (row["value"], row["se"]) for row in table}
    assert len(cells) == 18
    assert all(value == cells["kf", *rest] for (label, *rest), value in cells.items() if label == "mine")
    curves = files.read_records(Path("results/small~score/figures/errors.csv"))
    assert {row["filter"] for row in curves} == {"kf", "mine"}
    assert results.claims[0]["verdict"]
    assert ok("run", shown, "-q")
    ours = Results.open("results/small")
    assert ours.summary == [row for row in results.summary if row["filter"] != "mine"]


def test_the_folder_of_a_score_can_be_reported_and_run_again(shown: Path) -> None:
    ok("export", shown, "--filter", "kf", "--out", "ex", "-q")
    ok("score", shown, "ex/estimates.kf.csv", "-q")
    shutil.rmtree("ex")
    ok("report", "results/small~score")
    assert (
        "nothing to compute"
        in rkfbench("run", "results/small~score/scenario.yaml", "--out", "results/small~score").stderr
    )


def test_two_files_stand_beside_each_other_over_the_runs_that_both_have(shown: Path) -> None:
    ok("export", shown, "--filter", "kf", "--out", "a", "-q")
    ok("export", shown, "--filter", "hkf", "--out", "b", "--runs", "4", "-q")
    ok("score", shown, "a/estimates.kf.csv", "b/estimates.hkf.csv", "--label", "one", "--label", "two", "-q")
    results = Results.open("results/small~score")
    assert results.runs == 4
    for ours, theirs in (("kf", "one"), ("hkf", "two")):
        np.testing.assert_array_equal(
            results.values("default", "rate=0.4", theirs, "err_norm"),
            results.values("default", "rate=0.4", ours, "err_norm"),
        )


def own(path: Path, text: str, rows: list[str]) -> Path:
    path.write_text("\n".join([text, *rows]) + "\n")
    return path


def rows(case: str = "rate=0,", runs: int = 2, steps: int = 12, cells: str = "1,1,1,1") -> list[str]:
    return [f"{case}{run},{k},{cells}" for run in range(runs) for k in range(1, steps + 1)]


HEADER = "case,run,k,px,py,vx,vy"


def test_a_file_may_be_about_some_cases_and_have_no_covariance(shown: Path) -> None:
    file = own(Path("e.csv"), HEADER, rows())
    ok("score", shown, file, "-q")
    summary = Results.open("results/small~score").summary
    assert {row["case"] for row in summary if row["filter"] == "e"} == {"rate=0"}
    nees = next(row for row in summary if (row["filter"], row["metric"]) == ("e", "nees"))
    assert (nees["runs"], nees["failed"], nees["mean"]) == (2, 0, None)


def test_a_run_has_failed_from_an_empty_cell_on(shown: Path) -> None:
    lines = rows()
    lines[4] = "rate=0,0,5,1,,1,1"
    ok("score", shown, own(Path("e.csv"), HEADER, lines), "-q")
    results = Results.open("results/small~score")
    assert results.failed("default", "rate=0", "e").tolist() == [True, False]


@pytest.mark.parametrize(
    ("header", "lines", "told"),
    [
        (HEADER, rows("rate=9,"), "e.csv:2:1: case: no case 'rate=9' in the scenario"),
        (HEADER[5:], rows(""), "e.csv:1:1: no column 'case', and the scenario has rate=0, rate=0.4"),
        ("case,run,k,px,py,vx", rows(cells="1,1,1"), "e.csv:1:1: no column 'vy', which is needed"),
        ("case,k,px,py,vx,vy", [f"rate=0,{k},1,1,1,1" for k in range(1, 13)], "e.csv:1:1: no column 'run'"),
        (HEADER, rows(cells="1,1,one,1"), "e.csv:2:16: vx: 'one' is no finite number"),
        (HEADER, rows(steps=11), "e.csv:13:10: k: run 0, k 12 is expected here, not run 1, k 1"),
        (HEADER, rows()[:-1], "e.csv:24:10: k: run 1 ends at k = 11, not 12"),
        (HEADER + ",P_px_px", rows(cells="1,1,1,1,1"), "e.csv:1:1: no column 'P_px_py', which goes with P_px_px"),
        (HEADER, ["rate=0,0,1,1,1"], "e.csv:2:1: 5 cells, the header has 7"),
    ],
)
def test_a_fault_of_a_file_of_estimates_is_told_with_its_place(
    shown: Path, header: str, lines: list[str], told: str
) -> None:
    result = rkfbench("score", shown, own(Path("e.csv"), header, lines))
    assert (result.exit_code, result.stdout) == (2, "")
    assert result.stderr.startswith(told)
    assert not Path("results").exists()


def test_more_runs_than_a_file_has_are_refused(shown: Path) -> None:
    file = own(Path("e.csv"), HEADER, rows())
    with pytest.raises(ScenarioError, match=r"2 runs here, the study has 6: add --runs 2"):
        load(shown, estimates={"e": file})
    result = rkfbench("score", shown, file, "--label", "kf")
    assert result.exit_code == 2
    assert "two filters are labelled 'kf'" in result.stderr
    assert rkfbench("score", shown, file, "--label", "a", "--label", "b").exit_code == 2


def test_estimates_may_stand_in_a_scenario(shown: Path) -> None:
    own(Path("e.csv"), HEADER, rows())
    shown.write_text(SMALL.replace("filters: [kf,", "filters: [{use: estimates, file: e.csv, label: e}, kf,"))
    ok("run", shown, "--runs", "2", "-q")
    assert "e" in {row["filter"] for row in Results.open("results/small~runs=2").summary}
    own(Path("e.csv"), HEADER, rows(cells="2,1,1,1"))
    assert "filter e changed" in rkfbench("run", shown, "--runs", "2").stderr


def test_cases_whose_files_would_have_one_name_are_told(small: Path) -> None:
    small.write_text(SMALL + "cases: {R 2: {}, R-2: {}}\n")
    result = rkfbench("export", small)
    assert result.exit_code == 2
    assert "the files of 'R 2,rate=0' and 'R-2,rate=0' would have one name" in result.stderr
    assert not Path("results").exists()
    ok("export", small, "--case", "R 2,rate=0")


FORMS = {
    "use": "{use: estimates, file: e.csv, label: e}",
    "short": "{estimates: {file: e.csv}, label: e}",
    "inside": "{quantised: {filter: {use: estimates, file: e.csv}, step: 1}, label: e}",
    "inside, use": "{use: quantised, filter: {estimates: {file: e.csv}}, label: e}",
}


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_estimates_are_the_same_in_every_form(shown: Path, form: str) -> None:
    own(Path("e.csv"), HEADER, rows())
    shown.write_text(SMALL.replace("filters: [kf,", f"filters: [{form}, kf,").replace("paper: 6", "paper: 2"))
    run_study(load(shown), Path("r"))
    spec = load(shown).cells[0].spec
    spec["filters"][0] = {"use": "estimates", "file": "e.csv", "case": "rate=0", "reading": "default", "label": "e"}
    expected = compute({**spec, "metrics": ["err_norm"]}, 5, 0, 2, ["e"]).filters["e"].values["err_norm"]
    np.testing.assert_array_equal(Results.open("r").values("default", "rate=0", "e", "err_norm"), expected)
    assert Path("r/data/e.csv").read_bytes() == Path("e.csv").read_bytes()
    Path("e.csv").rename("moved.csv")
    assert run_study(load("r/scenario.yaml"), Path("r")).computed == 0
    own(Path("e.csv"), HEADER, rows(cells="2,1,1,1"))
    assert run_study(load(shown), Path("r")).computed == 1
    own(Path("e.csv"), HEADER.replace("case", "cases"), rows())
    with pytest.raises(ScenarioError, match="no column 'case'"):
        load(shown)


def test_an_override_may_name_another_file_of_estimates(shown: Path) -> None:
    for name in ("e.csv", "f.csv"):
        Path("deep").mkdir(exist_ok=True)
        own(Path("deep") / name, HEADER, rows())
    path = Path("deep/small.yaml")
    text = SMALL.replace("filters: [kf,", "filters: [{use: estimates, file: e.csv, label: e}, kf,")
    path.write_text(text.replace("paper: 6", "paper: 2") + "readings: {one: {filters.e.file: f.csv}}\n")
    run_study(load(path), Path("r"))
    assert {each.name for each in Path("r/data").iterdir()} == {"e.csv", "f.csv"}
    assert run_study(load("r/scenario.yaml"), Path("r")).computed == 0


def test_estimates_that_change_while_a_study_runs_end_it(shown: Path) -> None:
    own(Path("e.csv"), HEADER, rows())
    shown.write_text(SMALL.replace("filters: [kf,", "filters: [{estimates: {file: e.csv}, label: e}, kf,"))
    spec = load(shown, runs=2).cells[0].spec
    own(Path("e.csv"), HEADER, rows(cells="2,1,1,1"))
    with pytest.raises(InputChanged, match=r"e\.csv was changed"):
        compute(spec, 5, 0, 2, ["e"])


def test_a_list_of_files_is_refused(shown: Path) -> None:
    shown.write_text(SMALL.replace("filters: [kf,", "filters: [{use: estimates, file: [e.csv, f.csv]}, kf,"))
    with pytest.raises(ScenarioError, match="give each a filter with a label of its own"):
        load(shown)


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
def test_the_octave_example_of_the_readme_is_our_kalman_filter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    options = {"sets": ["steps=100"], "runs": 3}
    ok("export", "contamination-rates", "--case", "rate=0.4", "--runs", "3", "--set", "steps=100")
    Path("kf.m").write_text(block("octave"))
    assert len(block("octave").splitlines()) <= 15
    subprocess.run(["octave-cli", "--quiet", "kf.m"], check=True, capture_output=True)
    scenario = load("contamination-rates", estimates={"octave": Path("estimates.csv")}, **options)
    (cell,) = [cell for cell in scenario.cells if cell.case == "rate=0.4" and cell.reading == "literal"]
    result = compute({**cell.spec, "metrics": ["err_norm"]}, scenario.seed, 0, 3, ["kf", "octave"])
    np.testing.assert_allclose(
        result.filters["octave"].values["err_norm"], result.filters["kf"].values["err_norm"], rtol=1e-9
    )
