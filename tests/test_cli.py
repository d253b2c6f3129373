"""The command as a user meets it: data and notes on their streams, exit codes, one clear message for what is wrong."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from rkfbench.cli.commands import app
from rkfbench.errors import UsageError
from rkfbench.scenario import load_bundled
from rkfbench.store import Results
from rkfbench.store.lock import locked


def rkfbench(*args: str | Path) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def tables(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.glob("*.csv"))}


def test_run_writes_results_and_prints_only_their_folder(small: Path) -> None:
    result = rkfbench("run", small)
    assert (result.exit_code, result.stdout) == (0, "results/small\n")
    assert "small: rate=0.4 (default): 6 runs, 2 filters\n" in result.stderr
    assert len(Results.open("results/small").values("default", "rate=0.4", "hkf", "err_norm")) == 6


def test_a_second_run_says_that_there_is_nothing_to_compute(small: Path) -> None:
    rkfbench("run", small)
    before = tables(Path("results/small"))
    result = rkfbench("run", small)
    assert "nothing to compute, results/small is up to date" in result.stderr
    assert tables(Path("results/small")) == before


def test_options_that_change_the_scenario_get_a_folder_of_their_own(small: Path) -> None:
    result = rkfbench("run", small, "--runs", "3", "--set", "measurement_noise.rate=0.2", "-q")
    assert (result.exit_code, result.stderr) == (0, "")
    folder = Path(result.stdout.strip())
    assert folder == Path("results/small~measurement_noise.rate=0.2,runs=3")
    assert {row["rate"] for row in Results.open(folder).summary} == {0.2}


def test_names_as_long_as_they_may_be_make_names_of_files(small: Path) -> None:
    name, label = "n" * 100, "β" * 130  # 260 bytes
    text = small.read_text().replace("name: small", f"name: {name}").replace("threshold: 2", f"label: {label}")
    text += f"readings: {{default: {{}}, {label}: {{steps: 11}}}}\ncases: {{{label}: {{}}}}\n"
    small.write_text(text + f"figures: [{{id: {name}, kind: bars, metric: err_norm}}]\n")
    for command in ("run", "export", f"trace --filter {label} --case rate=0 --run 1"):
        result = rkfbench(*command.split(), small, "--runs", "3")
        assert result.exit_code == 0, result.stderr


def test_the_first_runs_of_a_longer_study_are_the_short_study(small: Path) -> None:
    rkfbench("run", small, "--runs", "3", "--out", "short")
    rkfbench("run", small, "--runs", "130", "--out", "long")
    short, long = (Results.open(each).values("default", "rate=0.4", "hkf", "err_norm") for each in ("short", "long"))
    assert short.tolist() == long[:3].tolist()


def test_any_number_of_processes_gives_the_same_bytes(small: Path) -> None:
    for jobs in ("1", "2"):
        assert rkfbench("run", small, "--jobs", jobs, "--out", jobs).exit_code == 0
    assert tables(Path("1")) == tables(Path("2"))


def test_dask_is_an_engine_like_the_others(small: Path) -> None:
    pytest.importorskip("distributed")
    command = [sys.executable, "-m", "rkfbench", "run", small, "--scheduler", "local", "--jobs", "1", "--out", "dask"]
    environment = os.environ | {"PYTHONPATH": ROOT}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout == "dask\n"
    assert "Traceback" not in done.stderr
    assert rkfbench("run", small, "--jobs", "1", "--out", "serial").exit_code == 0
    assert tables(Path("dask")) == tables(Path("serial"))


def test_shards_say_what_is_left_and_a_plain_run_merges_them(small: Path) -> None:
    first = rkfbench("run", small, "--shard", "1/2", "--out", "r")
    assert (first.exit_code, first.stdout) == (0, "r\n")
    assert "small: shard 1/2: 1 blocks computed, 0 were there;" in first.stderr
    assert "still to be computed by other shards: 1; then the same command without --shard" in first.stderr
    second = rkfbench("run", small, "--shard", "2/2", "--out", "r")
    assert "all blocks of the study are there: the same command without --shard makes the tables" in second.stderr
    assert not Path("r/summary.csv").exists()
    assert "nothing to compute" in rkfbench("run", small, "--out", "r").stderr
    rkfbench("run", small, "--out", "whole")
    assert tables(Path("r")) == tables(Path("whole"))


def test_shards_of_one_scenario_do_not_go_beside_those_of_another(small: Path) -> None:
    assert rkfbench("run", small, "--shard", "1/2", "--out", "r").exit_code == 0
    small.write_text(small.read_text().replace("name: small", "name: other"))
    for more in (["--shard", "1/2"], []):
        refused = rkfbench("run", small, "--out", "r", *more)
        assert (refused.exit_code, refused.stdout) == (2, "")
        assert "r holds blocks of 'small': choose another folder with --out" in refused.stderr


def test_a_study_that_stops_where_it_is_precise_says_so_wherever_claims_are_judged(claiming: Path) -> None:
    result = rkfbench("run", claiming, "--precision", "err_norm=0.5", "--max-runs", "4")
    assert result.exit_code == 0
    folder = Path("results/small~max-runs=4,precision=err_norm=0.5")
    assert "with at most 4 runs\n" in result.stderr
    remark = "stopped at 4 runs: precision err_norm=0.5 reached"
    assert f"small: {remark}" in result.stderr
    assert [remark in line["reason"] for line in Results.open(folder).claims] == [True]
    assert remark in (folder / "claims.md").read_text()
    assert json.loads((folder / "manifest.json").read_text())["precision"]["reached"] is True
    assert rkfbench("verify", folder).exit_code == 0
    rkfbench("report", folder)
    for page in ("report.md", "report.html"):
        assert f"the number of runs was not fixed beforehand ({remark}" in (folder / page).read_text()
    rkfbench("run", claiming)
    rkfbench("report", "results/small")
    assert "fixed beforehand" not in Path("results/small/report.md").read_text()


def test_it_is_said_in_how_large_blocks_the_runs_for_a_precision_come(small: Path) -> None:
    result = rkfbench("run", small, "--precision", "err_norm=0.5", "--set", "steps=2000", "--set", "metrics=[err_norm]")
    assert "with at most 100000 runs in blocks of 256\n" in result.stderr
    assert "stopped at 256 runs" in result.stderr
    assert "Runs come in whole blocks" in " ".join(rkfbench("run", "--help").stdout.split())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--precision", "0.1", "--runs", "3"], "leave out --runs"),
        (["--max-runs", "3"], "the limit of --precision"),
        (["--precision", "err_norm=0"], "positive number"),
        (["--shard", "1/2", "--precision", "0.1"], "cannot go with --precision"),
        (["--shard", "1/2", "--fresh"], "blocks of other shards"),
        (["--shard", "3/2"], "i from 1 to n"),
    ],
)
def test_options_that_make_no_sense_together_are_refused(small: Path, options: list[str], message: str) -> None:
    result = rkfbench("run", small, *options)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr
    assert not Path("results").exists()


def test_run_as_json(small: Path) -> None:
    (outcome,) = json.loads(rkfbench("run", small, "--json", "-q").stdout)
    assert (outcome["folder"], outcome["computed"], outcome["failures"]) == ("results/small", 2, [])


def test_the_resolved_scenario_runs_again_to_the_same_numbers(small: Path) -> None:
    rkfbench("run", small, "--runs", "4", "--out", "a")
    assert rkfbench("run", "a/scenario.yaml", "--out", "b").exit_code == 0
    assert tables(Path("a")) == tables(Path("b"))


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["nowhere.yaml"], "nowhere.yaml"),
        (["smal"], "no scenario 'smal'"),
        (["small.yaml", "--set", "measurement_noise.rat=1"], "measurement_noise.rat"),
        (["small.yaml", "--set", "measurement_noise.rate=2"], "rate"),
        (["small.yaml", "--set", "steps=5", "--sweep", "steps=5,6"], "steps: stands against --sweep steps=5,6"),
        (
            ["small.yaml", "--set", "measurement_noise=null", "--sweep", "measurement_noise.rate=0,1"],
            "measurement_noise: stands against --sweep measurement_noise.rate=0,1",
        ),
        (["small.yaml", "--runs", "0"], "--runs"),
        (["small.yaml", "--jobs", "0"], "--jobs"),
        (["small.yaml", "--colour"], "--colour"),
        ([], "scenarios"),
    ],
)
def test_what_is_wrong_is_said_on_stderr_and_nothing_is_written(small: Path, args: list[str], message: str) -> None:
    result = rkfbench("run", *args)
    assert (result.exit_code, result.stdout) == (2, "")
    assert message in result.stderr.lower()
    assert "Traceback" not in result.stderr
    assert not Path("results").exists()


def test_what_is_wrong_with_an_option_is_said_in_our_words() -> None:
    for arguments, told in (
        (["list", "foo"], "Invalid value for 'kind': 'foo' is not one of 'filters', 'moments',"),
        (["run", "ungm", "--runs", "x"], "Invalid value for '--runs': should be a valid integer"),
    ):
        result = rkfbench(*arguments)
        assert (result.exit_code, told in result.stderr) == (2, True), result.stderr


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("metric: err_norm}", "metric: err_norm/2}", "no metric 'err_norm/2' here: in arithmetic spaces stand around"),
        ("metric: err_norm@k", "metric: rmse@k", ": what is shown or judged must stand in `metrics`"),
        ("metric: err_norm, filters", "metric: err_norm*2, filters", "as in 'err_norm * 2'"),
        ("metric: err_norm}", "metric: err_norm, cases: rate=1}", "tables.errors.cases.0: no case 'rate=1' here"),
    ],
)
def test_what_to_do_about_a_metric_that_is_not_measured(claiming: Path, before: str, after: str, message: str) -> None:
    claiming.write_text(claiming.read_text().replace(before, after))
    result = rkfbench("validate", claiming)
    assert (result.exit_code, message in result.stderr) == (2, True), result.stderr


def test_one_case_needs_no_brackets(claiming: Path) -> None:
    claiming.write_text(claiming.read_text().replace("metric: err_norm}", "metric: err_norm, cases: rate=0.4}"))
    assert rkfbench("run", claiming).exit_code == 0
    assert "0.4" in Path("results/small/tables/errors.csv").read_text()
    assert rkfbench("run", "results/small/scenario.yaml", "--out", "again").exit_code == 0


def test_a_bad_scenario_overwrites_nothing(small: Path) -> None:
    rkfbench("run", small)
    before = tables(Path("results/small"))
    small.write_text(small.read_text().replace("rate: 0.05", "rat: 0.05"))
    assert rkfbench("run", small).exit_code == 2
    assert tables(Path("results/small")) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_may_not_be_written_is_one_message(small: Path) -> None:
    Path("closed").mkdir(mode=0o500)
    result = rkfbench("run", small, "--out", "closed/r")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 2)
    assert "cannot write closed/r: Permission denied" in result.stderr


def test_an_output_folder_below_a_file_is_one_message(small: Path) -> None:
    result = rkfbench("run", small, "--out", "small.yaml/r")
    assert (result.exit_code, "Traceback" in result.stderr) == (2, False)
    assert "cannot write small.yaml/r" in result.stderr


def test_scenarios_of_the_same_name_are_not_written_into_one_folder(small: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.yaml"
    again.write_text(small.read_text())
    result = rkfbench("run", small, again)
    assert result.exit_code == 2
    assert "several scenarios would write into" in result.stderr
    assert "give each a name of its own" in result.stderr


def test_an_unexpected_exception_is_one_line_and_shows_its_place_with_v(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*args: Any, **options: Any) -> None:
        raise ZeroDivisionError("by zero")

    monkeypatch.setattr("rkfbench.study.run.compute", broken)
    plain, verbose = rkfbench("run", small), rkfbench("run", small, "-v")
    assert (plain.exit_code, verbose.exit_code) == (1, 1)
    assert plain.stderr.splitlines()[-2] == "ZeroDivisionError: by zero"
    assert "run again with -v" in plain.stderr.splitlines()[-1]
    assert "Traceback" not in plain.stderr
    assert "Traceback" in verbose.stderr


def test_a_filter_that_raises_is_named_and_ends_with_exit_code_1(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import rkfbench.study.compute as module

    together = module.together

    def broken(specs: Any, seed: int, block: int, runs: int, labels: Any) -> Any:
        if "hkf" in labels:
            raise ValueError("no such root")
        return together(specs, seed, block, runs, labels)

    monkeypatch.setattr(module, "together", broken)
    result = rkfbench("run", small)
    assert result.exit_code == 1
    assert "small: case rate=0.4 (default), filter hkf, block 0: ValueError: no such root" in result.stderr
    assert {row["filter"] for row in Results.open("results/small").summary} == {"kf"}


@pytest.mark.parametrize("engine", [["--jobs", "1"], ["--jobs", "2"], ["--jobs", "2", "--scheduler", "local"]], ids=str)
def test_ctrl_c_keeps_finished_blocks_and_says_how_to_go_on(small: Path, engine: list[str]) -> None:
    command = [sys.executable, "-m", "rkfbench", "run", small, "--runs", "20000", "--set", "steps=500", *engine]
    environment = os.environ | {"PYTHONPATH": ROOT}
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env=environment, start_new_session=True
    ) as process:
        blocks = Path("results/small~steps=500,runs=20000/blocks")
        deadline = time.monotonic() + 120
        while len(list(blocks.glob("*.block"))) < 4 and time.monotonic() < deadline:  # the last ones may be incomplete
            time.sleep(0.02)
        os.killpg(process.pid, signal.SIGINT)  # a terminal sends it to all of them
        _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert re.search(r"interrupted; \d+ finished blocks? of small kept: the same command goes on from there\n", stderr)
    assert "Traceback" not in stderr
    assert any(blocks.glob("*.block"))


def test_a_closed_pipe_is_quiet(small: Path) -> None:
    command = f"{sys.executable} -m rkfbench schema | head -1"
    done = subprocess.run(
        command, shell=True, capture_output=True, text=True, check=True, env=os.environ | {"PYTHONPATH": ROOT}
    )
    assert (done.stdout, done.stderr) == ("{\n", "")


@pytest.mark.parametrize("arguments", ["--help", "list --help", "list filters", "list filters --json"])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_an_output_that_takes_no_more_is_one_message(arguments: str) -> None:
    def said(redirected: str) -> tuple[int, str]:
        command = f"{sys.executable} -m rkfbench {arguments} {redirected}"
        environment = os.environ | {"PYTHONPATH": ROOT}
        done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False, env=environment)
        return done.returncode, done.stderr

    assert said("> /dev/full") == (1, "cannot write to the standard output: No space left on device\n")
    assert said(">&-") == (0, "")  # closed: whoever does that wants to hear nothing


@pytest.mark.parametrize("redirected", ["2> /dev/full", "2>&-"])
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_progress_that_cannot_be_written_ends_nothing(small: Path, redirected: str) -> None:
    command = f"{sys.executable} -m rkfbench run small.yaml --fresh {redirected}"
    environment = os.environ | {"PYTHONPATH": ROOT}
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stdout) == (0, "results/small\n")


@pytest.mark.parametrize("engine", [["--jobs", "1"], ["--jobs", "2"], ["--scheduler", "local", "--jobs", "1"]], ids=str)
def test_what_a_plug_in_prints_is_no_result(small: Path, engine: list[str]) -> None:
    Path("loud.py").write_text(
        "print('imported')\n\n\ndef loud(model, y, x0, P0, Q, R):\n    print('called')\n    return y[:, [0, 1, 2, 2]]\n"
    )
    if "--scheduler" in engine:
        pytest.importorskip("distributed")
    small.write_text(small.read_text().replace("filters: [kf,", "filters: [kf, {use: loud.py:loud},"))
    command = [sys.executable, "-m", "rkfbench", "run", small, "--json", "--runs", "300", *engine]
    environment = os.environ | {"PYTHONPATH": ROOT}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert json.loads(done.stdout)[0]["failures"] == []
    assert {"imported", "called"} <= set(done.stderr.splitlines())
    assert rkfbench("check", "loud.py:loud").stdout.startswith("loud.py:loud on ")


def test_validate_tells_every_problem_with_its_line(small: Path) -> None:
    assert rkfbench("validate", small).stdout == "small.yaml: valid (readings: 1, cases: 2, filters: 2)\n"
    small.write_text(small.read_text().replace("rate: 0.05", "rat: 0.05").replace("seed: 5", "seed: five"))
    result = rkfbench("validate", small)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "small.yaml:3:" in result.stderr
    assert "small.yaml:11:" in result.stderr
    (verdict,) = json.loads(rkfbench("validate", small, "--json").stdout)
    assert not verdict["valid"]
    assert {problem["line"] for problem in verdict["problems"]} >= {3, 11}


@pytest.mark.parametrize("command", ["validate", "run"])
def test_a_claim_that_cannot_be_judged_is_refused_with_its_line_before_anything_runs(
    claiming: Path, command: str
) -> None:
    claiming.write_text(claiming.read_text().replace("err_norm, filters", "pooled_rmse, filters"))
    result = rkfbench(command, claiming)
    assert (result.exit_code, result.stdout, Path("results").exists()) == (2, "", False)
    assert re.search(r"small.yaml:\d+:24: claims.outliers.ordering.metric: unknown metric 'pooled_rmse'", result.stderr)


@pytest.mark.parametrize("kind", ["filters", "moments", "weights", "schemes", "models", "noises", "metrics"])
def test_everything_that_is_listed_can_be_shown(kind: str) -> None:
    names = [row["name"] for row in json.loads(rkfbench("list", kind, "--json").stdout)]
    assert names
    for name in names:
        shown = rkfbench("show", name)
        assert (shown.exit_code, shown.stdout.startswith(f"{name} (") or f"\n# {name} (" in shown.stdout) == (0, True)


def test_a_scenario_with_the_name_of_a_model_is_shown_before_it_and_can_be_run(small: Path) -> None:
    shown = rkfbench("show", "ungm").stdout
    assert shown.startswith("name: ungm\n")
    assert "\n# ungm (model; " in shown
    Path("shown.yaml").write_text(shown)
    assert rkfbench("validate", "shown.yaml").exit_code == 0
    scenario, model = json.loads(rkfbench("show", "ungm", "--json").stdout)
    assert (scenario["name"], model["kind"]) == ("ungm", "model")


def test_a_scenario_is_shown_with_its_defaults(small: Path) -> None:
    shown = rkfbench("show", "small.yaml").stdout
    Path("shown.yaml").write_text(shown)
    assert rkfbench("validate", "shown.yaml").exit_code == 0
    assert json.loads(rkfbench("show", "small.yaml", "--json").stdout)["name"] == "small"


def test_an_unknown_name_is_answered_with_a_near_one() -> None:
    result = rkfbench("show", "aladfk")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "did you mean 'aladkf'?" in result.stderr


def test_what_is_not_finite_is_null_as_json(small: Path) -> None:
    rkfbench("run", small, "-q", "--out", "a")

    def never(name: str) -> None:
        raise ValueError(f"{name} is not JSON")

    found = json.loads(rkfbench("compare", "a", "a", "--json").stdout, parse_constant=never)
    assert None in [value for each in (found if isinstance(found, list) else [found]) for value in each.values()]


def test_compare_tells_same_from_different(small: Path) -> None:
    for out, options in {"a": [], "b": [], "c": ["--seed", "6"], "d": ["--set", "filters.hkf.threshold=0.01"]}.items():
        rkfbench("run", small, "--out", out, "--runs", "40", *options)  # six pairs would tell little
    assert rkfbench("compare", "a", "b").stdout.startswith("same bytes")
    other_seed = rkfbench("compare", "a", "c")
    assert (other_seed.exit_code, other_seed.stdout.split(" (")[0]) == (0, "no statistical difference")
    other_filter = rkfbench("compare", "a", "d")
    assert other_filter.exit_code == 3
    assert "hkf" in other_filter.stdout
    assert "kf " not in re.sub("hkf", "", other_filter.stdout.split("\n", 2)[2])


def test_compare_counts_what_one_folder_has_alone_and_blames_only_what_full_does_not_explain(small: Path) -> None:
    small.write_text(small.read_text().replace("threshold: 2}", "threshold: 2}, {use: aladkf, extra: true}"))
    for out, options in {"a": [], "b": ["--full"], "c": ["--set", "metrics=[err_norm]"]}.items():
        rkfbench("run", small, "--out", out, *options)
    full = "(extras and switches: it alone was run with --full)\n"
    told = f"only in b: 4 rows of summary.csv {full}only in b: 2 curves of series.csv {full}"
    for pair in (("a", "b"), ("b", "a")):
        fuller = rkfbench("compare", *pair)
        assert (fuller.exit_code, fuller.stdout) == (0, f"same to the tolerance (8 rows of summary.csv)\n{told}")
    lacking = rkfbench("compare", "a", "c")
    assert lacking.exit_code == 3
    assert lacking.stdout.startswith("different (4 rows of summary.csv)\nonly in a: 4 rows of summary.csv\n")
    small.write_text(small.read_text().replace("sweep: {measurement_noise.rate: [0, 0.4]}", ""))
    rkfbench("run", small, "--out", "e")
    other = rkfbench("compare", "a", "e")
    assert (other.exit_code, other.stdout) == (2, "")
    assert "a (small) and e (small) are different experiments" in other.stderr


def test_verify_lists_claims_and_notices_a_region_that_moved(claiming: Path) -> None:
    rkfbench("run", claiming)
    result = rkfbench("verify", "results/small")
    assert result.exit_code == 0
    assert re.search(r"^outliers +default +reproduced ", result.stdout, re.M)
    claiming.write_text(claiming.read_text().replace("along: cases}", "along: cases, margin: 1000}"))
    moved = rkfbench("verify", "results/small")
    assert moved.exit_code == 3
    assert re.search(r"^outliers +default +not reproduced ", moved.stdout, re.M)
    assert "reproduced -> not reproduced" in moved.stderr


def test_what_a_clock_decides_or_stands_beside_is_told_and_decides_no_exit_code(claiming: Path) -> None:
    measured = "metric: err_norm, filters: hkf, cases: [rate=0.4]"
    claiming.write_text(
        claiming.read_text().replace("claims:\n", "claims:\n" + SLOW.replace("BESIDE", measured + ", above: 0"))
    )
    assert rkfbench("run", claiming).exit_code == 0
    text = claiming.read_text().replace("above: 0}", "above: 1e9}")
    claiming.write_text(text.replace("filters: kf, below: 1e9", "filters: kf, below: 1e-9"))
    result = rkfbench("verify", "results/small")
    assert result.exit_code == 0
    told = [line for line in result.stderr.splitlines() if "(no difference that counts)" in line]
    verdicts = [line.rpartition(" (")[0].rpartition(": ")[2] for line in told]
    assert [each.partition(" -> ")[0] for each in verdicts] == ["reproduced"] * 2
    claiming.write_text(text.replace(*HARDER))
    result = rkfbench("verify", "results/small")
    assert result.exit_code == 3
    assert "1 verdicts differ from claims.csv" in result.stderr


SLOW = """\
  - id: quick
    says: a step takes no longer than this
    bound: {metric: time_ms, filters: kf, below: 1e9, cases: [rate=0.4]}
    beside:
      - bound: {BESIDE}
"""
HARDER = ("along: cases}", "along: cases, margin: 1000}")


def test_verify_judges_by_the_file_that_made_the_folder_wherever_it_is_called(
    claiming: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rkfbench("run", claiming)
    other = tmp_path / "other"
    other.mkdir()
    (other / "small.yaml").write_text(claiming.read_text().replace(*HARDER))
    monkeypatch.chdir(other)
    result = rkfbench("verify", "../results/small")
    assert result.exit_code == 0
    assert f"../results/small: judged as {claiming} says" in result.stderr
    assert str(tmp_path) not in Path("../results/small/manifest.json").read_text()
    claiming.write_text(claiming.read_text().replace(*HARDER))
    assert rkfbench("verify", "../results/small").exit_code == 3


def test_verify_judges_by_the_stored_scenario_where_the_file_describes_another_experiment(claiming: Path) -> None:
    rkfbench("run", claiming)
    text = claiming.read_text()
    claiming.write_text(text.replace(*HARDER).replace("steps: 12", "steps: 13"))
    result = rkfbench("verify", "results/small")
    assert result.exit_code == 0
    assert "results/small: judged as results/small/scenario.yaml says" in result.stderr
    assert rkfbench("explain", "outliers").stdout.count("reproduced") == 1
    rkfbench("run", claiming)
    assert rkfbench("verify", "results/small").exit_code == 0


def test_an_own_scenario_under_the_name_of_a_bundled_one_is_judged_as_its_own_file_says(
    claiming: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bundled = tmp_path / "bundled"
    (bundled / "papers").mkdir(parents=True)
    (bundled / "small.yaml").write_text(claiming.read_text().replace(*HARDER))
    monkeypatch.setattr("rkfbench.scenario.files.FOLDER", bundled)
    load_bundled.cache_clear()
    rkfbench("run", claiming, "--out", "mine")
    assert json.loads(Path("mine/manifest.json").read_text())["source"] == "../small.yaml"
    assert rkfbench("verify", "mine").exit_code == 0
    rkfbench("run", "small", "--out", "theirs")
    assert json.loads(Path("theirs/manifest.json").read_text())["source"] is None
    assert "not reproduced" in rkfbench("verify", "theirs").stdout
    load_bundled.cache_clear()


def test_times_are_kept_apart_and_measured_only_once(claiming: Path) -> None:
    rkfbench("run", claiming)
    before = Path("results/small/timings/repeats.csv").read_bytes()
    results = Results.open("results/small")
    times = results.values("default", "rate=0", "kf", "time_ms")
    assert len(times) >= 10
    assert min(times) > 0
    assert "time_ms" not in {row["metric"] for row in results.summary}
    rkfbench("run", claiming)
    assert Path("results/small/timings/repeats.csv").read_bytes() == before


def test_verdicts_edited_by_hand_are_refused(claiming: Path) -> None:
    rkfbench("run", claiming)
    claims = Path("results/small/claims.csv")
    claims.write_text(claims.read_text().replace("reproduced", "not reproduced"))
    result = rkfbench("verify", "results/small")
    assert (result.exit_code, result.stdout) == (2, "")
    assert "claims.csv is not what rkfbench wrote" in result.stderr


def test_explain_tells_what_was_measured_and_how_to_repeat_it(claiming: Path) -> None:
    assert rkfbench("explain", "outliers").exit_code == 2  # no results yet
    rkfbench("run", claiming)
    text = rkfbench("explain", "outliers").stdout
    for part in (
        "outliers make the error",
        "claimed > 0: reproduced",
        "would flip at",
        "interval",
        "% of the level",
    ):
        assert part in text
    *_, command = text.splitlines()
    assert command == f"repeat with: rkfbench run {claiming.name}"
    assert rkfbench(*command.split()[3:]).exit_code == 0
    assert "did you mean 'outliers'?" in rkfbench("explain", "outlier").stderr


def test_what_needs_extras_says_so_and_the_command_that_is_told_measures_it(claiming: Path) -> None:
    text = claiming.read_text().replace(
        "threshold: 2}", "threshold: 2}, {use: hkf, threshold: 9, label: wide, extra: true}"
    )
    wide = "ordering: {metric: err_norm, filters: [kf, wide], cases: rate=0.4}"
    claiming.write_text(text + f"  - {{id: robust, says: so is this, {wide}}}\n")
    rkfbench("run", claiming)
    said = rkfbench("explain", "robust").stdout
    assert "not run (needs extras: run with --full)" in said
    assert "needs extras: run with --full" in Path("results/small/claims.md").read_text()
    assert said.endswith("\nrepeat with: rkfbench run small.yaml --full\n")
    rkfbench("run", claiming, "--full")
    assert "not run" not in rkfbench("explain", "robust").stdout
    assert rkfbench("explain", "outliers").stdout.endswith("\nrepeat with: rkfbench run small.yaml\n")


def test_paper_claims_say_what_a_check_found_and_what_options_took_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = rkfbench("run", "contamination-rates", "--set", "measurement_noise.rate=0.1", "--runs", "2")
    folder = Path(run.stdout.strip())
    found = "deviation of aladkf.H5: 0, tolerance -1e-09: not reproduced (least eigenvalue 0 at k = 1 (rank 3 of 4)"
    changed = "not run (options or an edit changed the experiment: it has no case rate=0.3)"
    assert found in rkfbench("explain", "aladkf-H5", folder).stdout
    assert changed in rkfbench("explain", "aladkf-C3d", folder).stdout
    ledger = (folder / "claims.md").read_text()
    assert found in ledger
    assert changed in ledger
    assert rkfbench("verify", folder).exit_code == 0


def test_explain_counts_the_cells_of_a_claim_by_their_verdicts(claiming: Path) -> None:
    several = "bound: {metric: err_norm, filters: [[kf, hkf]], cases: [rate=0, rate=0.4], above: 0}"
    claiming.write_text(claiming.read_text() + f"  - {{id: errors, says: they err, {several}}}\n")
    rkfbench("run", claiming)
    assert "[default] errors reproduced: all 4 cells\n" in rkfbench("explain", "errors").stdout
    assert "| reproduced (all 4 cells) |" in Path("results/small/claims.md").read_text()
    claiming.write_text(claiming.read_text().replace("above: 0}", "above: 1e9}"))
    assert "[default] errors not reproduced: all 4 cells\n" in rkfbench("explain", "errors").stdout


def test_the_caveat_of_a_reading_stands_in_the_ledger_and_in_what_is_told_of_it(claiming: Path) -> None:
    claiming.write_text(claiming.read_text() + "readings: {default: {caveat: A guess of ours.}}\n")
    rkfbench("run", claiming)
    ledger = Path("results/small/claims.md").read_text()
    assert ledger.startswith("# Claims of small that small decides\n\nA small study\n\nA guess of ours.\n\n|")
    assert "[default] A guess of ours." in rkfbench("explain", "outliers").stdout
    assert "[default] A guess of ours." in rkfbench("verify", "results/small").stderr


def test_report_is_made_again_from_the_results_to_the_same_bytes(claiming: Path) -> None:
    rkfbench("run", claiming)
    pages = ["results/small/report.html", "results/small/report.md"]
    assert rkfbench("report", "results/small").stdout.splitlines() == pages
    before = {path: path.read_bytes() for path in Path("results/small").rglob("*") if path.is_file()}
    rkfbench("report", "results/small")
    assert {path: path.read_bytes() for path in Path("results/small").rglob("*") if path.is_file()} == before


def test_a_report_waits_for_the_run_in_its_folder(claiming: Path) -> None:
    rkfbench("run", claiming)
    with locked(Path("results/small")):
        refused = rkfbench("report", "results/small")
    assert (refused.exit_code, refused.stdout) == (2, "")
    assert "results/small is in use by another run" in refused.stderr
    assert rkfbench("report", "nowhere").exit_code == 2
    assert not Path("nowhere").exists()


def test_a_report_holds_its_folders_until_its_pages_are_sealed(claiming: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import rkfbench.report.page as page

    write_report, tried = page.write_report, []

    def watched(folders: Any, place: Path) -> Any:
        for folder in {*folders, place}:
            with pytest.raises(UsageError, match="in use by another run"), locked(folder):
                pass
            tried.append(str(folder))
        return write_report(folders, place)

    monkeypatch.setattr(page, "write_report", watched)
    for out in ("a", "b"):
        rkfbench("run", claiming, "--out", out)
    assert rkfbench("report", "a", "./a", "--out", "b").exit_code == 0
    assert sorted(tried) == ["a", "b"]
    assert "report.html" in Results.open("b").manifest["files"]
    assert rkfbench("report", "a").exit_code == 0
    assert not list(Path().rglob(".lock"))


def test_a_report_into_the_folder_of_another_program_leaves_its_manifest_alone(claiming: Path) -> None:
    rkfbench("run", claiming)
    Path("web").mkdir()
    Path("web/manifest.json").write_text('{"name": "my app"}')
    assert rkfbench("report", "results/small", "--out", "web").exit_code == 0
    assert Path("web/manifest.json").read_text() == '{"name": "my app"}'


def test_a_report_is_not_written_over_the_page_of_somebody_else(claiming: Path) -> None:
    rkfbench("run", claiming)
    Path("web").mkdir()
    for _ in range(2):
        assert rkfbench("report", "results/small", "--out", "web").exit_code == 0
    for place in (Path("web"), Path("results/small")):
        (place / "report.html").write_text("mine")
        refused = rkfbench("report", "results/small", "--out", place)
        assert (refused.exit_code, (place / "report.html").read_text()) == (2, "mine")
        assert f"{place}/report.html was not written by rkfbench" in refused.stderr


def test_damaged_results_are_told_and_made_again(claiming: Path) -> None:
    rkfbench("run", claiming)
    times, summary = Path("results/small/timings/repeats.csv"), Path("results/small/summary.csv")
    before = summary.read_bytes()
    times.write_bytes(times.read_bytes()[:-9])
    summary.write_bytes(b"")
    again = rkfbench("run", claiming)
    assert again.exit_code == 0
    assert "small: making again summary.csv, timings/repeats.csv: not what was written there" in again.stderr
    assert summary.read_bytes() == before
    assert times.read_bytes().endswith(b"\n")
    assert "making again" not in rkfbench("run", claiming).stderr


def test_reproduce_compares_with_the_reference_that_was_published(
    claiming: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rkfbench.scenario.files.FOLDER", claiming.parent)
    reference = rkfbench("reproduce", "--reference")
    assert (reference.exit_code, reference.stderr.count("Traceback")) == (0, 0)
    kept = {path.name for path in Path("results/reference/small").iterdir()}
    assert {"summary.csv", "claims.csv", "manifest.json", "figures", "tables"} <= kept
    assert not {"runs.csv", "blocks"} & kept
    assert {row["runs"] for row in Results.open("results/reference/small").summary} == {8}

    ours = rkfbench("reproduce")
    assert ours.exit_code == 0
    assert "small: against results/reference: no statistical difference" in ours.stderr
    assert re.search(r"^small +default +", ours.stdout, re.M)
    assert Path("results/report.html").exists()


def test_help_and_version_answer_without_numpy() -> None:
    code = "import sys, rkfbench.cli.commands; print(sorted({'numpy', 'pydantic', 'rich'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "[]\n"
    assert rkfbench("--help").exit_code == 0
    assert re.fullmatch(r"\d+\.\d+\.\d+\n", rkfbench("--version").stdout)


ROOT = str(Path(__file__).parents[1])
