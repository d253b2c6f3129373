"""Choosing parameters: on tuning runs only, found where it is, reported on the test runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from rkfbench.catalogue import parameters
from rkfbench.cli.commands import app
from rkfbench.errors import UsageError
from rkfbench.metrics import METRICS
from rkfbench.report.tuned import sentence
from rkfbench.scenario import load
from rkfbench.store import files
from rkfbench.study import compute as module
from rkfbench.study.axes import Axis, axis, changed
from rkfbench.study.tune import better, tune
from rkfbench.study.tuning import SEED_STEP

HKF = {"use": "hkf", "label": "hkf", "threshold": 1.345, "root": "symmetric", "reuse_root": True}


def rkfbench(*args: str | Path) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def cell_of(path: Path, case: str = "rate=0.4") -> Any:
    return next(cell for cell in load(path).cells if cell.case == case)


def test_a_range_becomes_a_grid() -> None:
    assert axis("threshold=0.5:3:6", HKF, 13) == Axis("threshold", (0.5, 1.0, 1.5, 2.0, 2.5, 3.0), continuous=True)
    wide = axis("threshold=0.1:10:3", HKF, 13)
    assert (wide.values, wide.geometric) == ((0.1, 1.0, 10.0), True)
    assert axis("root=symmetric,cholesky", HKF, 13) == Axis("root", ("symmetric", "cholesky"))
    whole = axis("particles=100:200:3", {"use": "pf", "label": "pf"}, 13)
    assert (whole.values, whole.continuous) == ((100, 150, 200), False)
    inner = {"label": "h", "moments": "taylor", "weight": {"huber": {"threshold": 1.0}}}
    assert axis("weight.huber.threshold=1,2", inner, 3).values == (1, 2)
    assert changed(inner, {"weight.huber.threshold": 2})["weight"] == {"huber": {"threshold": 2}}
    assert inner["weight"] == {"huber": {"threshold": 1.0}}


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("threshold", "should be written parameter=first:last"),
        ("threshold=3:1", "first < last"),
        ("threshold=1:b", "first < last"),
        ("threshold=-1:1", "greater than 0"),
        ("treshold=1:2", "did you mean 'threshold'"),
        ("root=symmetric,square", "should be 'symmetric' or 'cholesky'"),
        ("a.b=1:2", "the filter 'hkf' has no 'a.b'"),
        ("threshold=1:.inf:3", "first < last, both finite"),
        ("threshold=1:1e309", "first < last, both finite"),
        ("threshold=-1e308:1e308", "first < last, both finite"),
        ("threshold=1:2:.inf", "a whole number as count"),
        ("threshold=1:2:3.9", "a whole number as count"),
        ("threshold=1e-320:2:1e9", "a whole number as count"),
        ("threshold=1e-320:2:1000000000", "between 2 and 1000 points are needed, not 1000000000"),
        ("label=a,b", "'label' is not a parameter of the filter"),
        ("extra=true,false", "'extra' is not a parameter of the filter"),
        ("timing=true,false", "'timing' is not a parameter of the filter"),
    ],
)
def test_a_range_that_makes_no_sense_is_said(text: str, told: str, small: Path) -> None:
    with pytest.raises(UsageError, match=told):
        axis(text, HKF, 5)
    result = rkfbench("tune", small, "--filter", "hkf", "--over", text)
    assert (result.exit_code, result.stdout) == (2, "")


def test_what_a_filter_is_told_apart_may_be_tuned() -> None:
    told = HKF | {"assumed": {"cov": 1.0}}
    assert axis("assumed.cov=1,2", told, 3).values == (1, 2)
    with pytest.raises(UsageError, match=r"unknown key \(did you mean 'cov'\?\)"):
        axis("assumed.cof=1,2", told, 3)


def test_a_parameter_that_is_given_twice_is_refused(small: Path) -> None:
    twice = ["--over", "threshold=1:2", "--over", "threshold=2:3"]
    result = rkfbench("tune", small, "--filter", "hkf", *twice)
    assert (result.exit_code, result.stdout) == (2, "")
    assert "--over threshold: given 2 times" in result.stderr


def test_too_many_settings_are_refused_before_they_are_made(small: Path) -> None:
    along = [Axis(path, tuple(range(1, 1001))) for path in ("a", "b", "c", "d")]
    with pytest.raises(UsageError, match="1000000000000 settings, more than 2000"):
        tune(cell_of(small), HKF, along, "rmse", seed=5, runs=40)


def test_the_choice_never_touches_the_test_runs(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[tuple[int, list[Any]]] = []
    compute = module.compute

    def watched(spec: Any, seed: int, *rest: Any) -> Any:
        seen.append((seed, [each["threshold"] for each in spec["filters"]]))
        return compute(spec, seed, *rest)

    monkeypatch.setattr(module, "compute", watched)
    found = tune(cell_of(small), HKF, [axis("threshold=0.5:3", HKF, 5)], "rmse", seed=5, runs=40)
    *tuning, (seed, settings) = seen
    assert len(tuning) > 3
    assert {seed for seed, _ in tuning} == {5 + SEED_STEP}
    assert (seed, settings) == (5, [1.345, found.chosen["threshold"]])  # and there only what was chosen, and before


def test_the_choice_is_what_the_tuning_runs_say_whatever_the_test_runs_are(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    along = [axis("threshold=0.5:3", HKF, 5)]
    before = tune(cell_of(small), HKF, along, "rmse", seed=5, runs=40)
    compute = module.compute

    def other_test_runs(spec: Any, seed: int, *rest: Any) -> Any:
        return compute(spec, 77 if seed == 5 else seed, *rest)

    monkeypatch.setattr(module, "compute", other_test_runs)
    after = tune(cell_of(small), HKF, along, "rmse", seed=5, runs=40)
    assert after.chosen == before.chosen
    assert after.test_chosen.row != before.test_chosen.row


def test_the_optimiser_improves_on_the_grid_and_stays_in_its_range(small: Path) -> None:
    along = [axis("threshold=0.3:3", HKF, 4)]
    coarse = tune(cell_of(small), HKF, along, "rmse", seed=5, runs=100, refine=False)
    fine = tune(cell_of(small), HKF, along, "rmse", seed=5, runs=100)
    means = {value: score.row["mean"] for value, score in fine.curves["threshold"]}
    assert coarse.chosen["threshold"] in along[0].values
    assert 0.3 < fine.chosen["threshold"] < 3
    assert (
        means[fine.chosen["threshold"]]
        < means[coarse.chosen["threshold"]]
        == min(score.row["mean"] for _, score in coarse.curves["threshold"])
    )
    around = [axis(f"threshold={fine.chosen['threshold'] - 0.2}:{fine.chosen['threshold'] + 0.2}", HKF, 41)]
    near = tune(cell_of(small), HKF, around, "rmse", seed=5, runs=100, refine=False)
    assert abs(near.chosen["threshold"] - fine.chosen["threshold"]) <= 0.02


def test_several_parameters_are_chosen_together(small: Path) -> None:
    inner = {"label": "c", "moments": "linear", "weight": {"correntropy": {"sigma": 2.0}}, "update": "once"}
    huber = {"label": "h", "moments": "linear", "weight": {"huber": {"threshold": 1.0, "root": "symmetric"}}}
    for spec, over in (
        (inner, ["weight.correntropy.sigma=1:30:4"]),
        (huber, ["weight.huber.threshold=0.3:3:4", "weight.huber.root=symmetric,cholesky"]),
    ):
        along = [axis(each, spec, 3) for each in over]
        found = tune(cell_of(small), spec, along, "rmse", seed=5, runs=40)
        best = min(score.rank for curve in found.curves.values() for _, score in curve)
        for path, curve in found.curves.items():
            assert dict(curve)[found.chosen[path]].rank == best


def test_two_continuous_parameters_go_through_the_simplex(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def bowl(spec: Any, seed: int, block: int, runs: int, labels: Any) -> Any:
        """A metric whose smallest mean lies at alpha = 0.7, kappa = 1.1."""
        parts = {}
        for each in spec["filters"]:
            a, b = each.get("alpha", 1.0) - 0.7, each.get("kappa", 1.0) - 1.1
            values = {"rmse": np.full(runs, a * a + b * b + a * b)}
            parts[each["label"]] = module.FilterResult(np.zeros(runs, bool), np.zeros(runs, bool), values, {})
        return module.BlockResult(parts)

    monkeypatch.setattr(module, "compute", bowl)
    spec = {"use": "ukf", "label": "ukf"}
    along = [axis("alpha=0.2:1.5:4", spec, 3), axis("kappa=0.5:3:4", spec, 3)]
    found = tune(cell_of(small), spec, along, "rmse", seed=1, runs=20)
    assert found.chosen == pytest.approx({"alpha": 0.7, "kappa": 1.1}, abs=0.02)
    assert found.tried < 16 + 60 + 10


@pytest.mark.parametrize("refine", [False, True])
def test_of_a_likelihood_the_largest_is_the_best(small: Path, refine: bool) -> None:
    along = [axis("assumed.cov=0.01:100:5", HKF | {"assumed": {"cov": 1.0}}, 5)]
    told = HKF | {"assumed": {"cov": 1.0}}
    found = tune(cell_of(small), told, along, "log_likelihood", seed=5, runs=40, refine=refine)
    means = {value: score.row["mean"] for value, score in found.curves["assumed.cov"]}
    assert means[found.chosen["assumed.cov"]] == max(means.values())
    assert min(means.values()) < max(means.values())
    assert "the largest mean of" in sentence(found, along)


def test_the_score_is_as_good_as_what_the_scenario_means_by_it(small: Path) -> None:
    assert better("score", cell_of(small)) == "small"
    small.write_text(small.read_text() + "score: err_norm[px]\n")
    assert better("score", cell_of(small)) == better("err_norm[px]", cell_of(small)) == "small"


def test_every_metric_of_one_filter_says_what_is_better_or_that_nothing_is() -> None:
    said = {name: entry.make()["quantity"] for name, entry in METRICS.items() if not _asks(entry)}
    by_word = {word: {n for n, q in said.items() if q.better == word} for word in ("small", "large", None)}
    assert by_word["large"] == {"log_likelihood", "lambda_auc", "distinct"}
    assert by_word[None] == {
        *("state", "error", "sd", "stated_rmse", "radial_sd", "tangential_sd", "principal_sd", "trace", "improvement"),
        *("nees", "nis", "nis_beyond", "whiteness", "excess", "excess_entry", "crossed", "score"),
        *("lambda_mean", "share_46", "share_47", "share_worse_given_46", "cond_S_top_lambda", "cond_ratio_top_psi"),
    }


def _asks(entry: Any) -> bool:
    return any(each.required for each in parameters(entry.make).values())


def test_an_own_metric_says_what_is_better(small: Path) -> None:
    source = "def mine(trial, states):\n    return -abs(trial.estimate.mean[:, 0] - trial.truth()[:, 0])\n"
    Path("mine.py").write_text(source)
    options = ["--filter", "hkf", "--over", "threshold=0.5,50", "--case", "rate=0.4", "--metric", "mine.py:mine"]
    refused = rkfbench("tune", small, *options)
    assert refused.exit_code == 2
    assert "'mine.py:mine' does not say what is better" in refused.stderr
    Path("mine.py").write_text(source + 'mine.better = "large"\n')
    chosen = rkfbench("tune", small, *options, "--runs", "50")
    assert "threshold = 0.5 (the largest mean of 2 settings tried)" in chosen.stderr
    Path("mine.py").write_text(source + 'mine.better = "more"\n')
    assert "`better` of mine.py:mine is 'more'" in rkfbench("tune", small, *options).stderr


def test_a_setting_with_failed_runs_is_behind_one_without(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compute = module.compute

    def failing(spec: Any, *rest: Any) -> Any:
        result = compute(spec, *rest)
        for each in spec["filters"]:
            if each["threshold"] < 1:  # where the smallest errors are
                result.filters[each["label"]].failed[0] = True
        return result

    monkeypatch.setattr(module, "compute", failing)
    found = tune(cell_of(small), HKF, [axis("threshold=0.4:3", HKF, 6)], "rmse", seed=5, runs=20)
    assert 1 <= found.chosen["threshold"] < 2


def test_the_command_writes_curves_choices_and_a_figure(small: Path) -> None:
    result = rkfbench("tune", small, "--filter", "hkf", "--over", "threshold=0.5:3", "--points", "4", "--runs", "30")
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0].split()[:3] == ["case", "setting", "threshold"]
    assert [line.split()[:2] for line in lines[1:]] == [
        ["rate=0", "before"], ["rate=0", "chosen"], ["rate=0.4", "before"], ["rate=0.4", "chosen"],
    ]  # fmt: skip
    folder = Path("results/small~tune-hkf,threshold=0.5-3,points=4,runs=30")
    assert {path.name for path in folder.glob("[!.]*")} == {"curves.csv", "chosen.csv", "curves.png", "curves.pdf"}
    chosen = files.read_records(folder / "chosen.csv")
    assert chosen[0]["threshold"] == 2
    assert chosen[3]["difference"] == pytest.approx(chosen[3]["mean"] - chosen[2]["mean"])
    curves = files.read_records(folder / "curves.csv")
    assert {row["runs"] for row in curves} == {30}
    assert {0.5, 3.0, chosen[1]["threshold"]} <= {row["value"] for row in curves if row["case"] == "rate=0"}
    assert "rate=0: threshold = " in result.stderr
    pictures = (folder / "curves.png").read_bytes()
    rkfbench("tune", small, "--filter", "hkf", "--over", "threshold=0.5:3", "--points", "4", "--runs", "30")
    assert (folder / "curves.png").read_bytes() == pictures


def test_nothing_of_somebody_else_or_of_other_options_is_written_over(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tune = ("tune", small, "--filter", "hkf", "--over", "threshold=1,3", "--runs", "10", "--grid", "--out", "t")
    assert rkfbench(*tune).exit_code == 0
    assert rkfbench(*tune).exit_code == 0
    chosen = Path("t/chosen.csv").read_bytes()
    Path("taken").write_text("mine")
    Path("mine").mkdir()
    Path("mine/curves.csv").write_text("mine")

    def never(*args: object, **options: object) -> None:
        raise AssertionError("the search has begun")

    monkeypatch.setattr("rkfbench.study.tune.tune", never)
    for out, more, told in (
        ("taken", [], "taken is a file: choose a folder with --out"),
        ("mine", [], "mine/curves.csv was not written by rkfbench"),
        ("t", ["--metric", "err_norm"], "t/curves.csv is of other options (small tune-hkf,threshold=1,3,"),
    ):
        refused = rkfbench(*tune[:-1], out, *more)
        assert (refused.exit_code, refused.stdout, told in refused.stderr) == (2, "", True), refused.output
    assert (Path("taken").read_text(), Path("mine/curves.csv").read_text()) == ("mine", "mine")
    assert Path("t/chosen.csv").read_bytes() == chosen


def test_the_setting_before_is_that_of_the_study(small: Path) -> None:
    rkfbench("run", small, "-q")
    rkfbench("tune", small, "--filter", "hkf", "--over", "threshold=1,3", "--metric", "err_norm")
    from rkfbench.store import Results

    before = files.read_records(Path("results/small~tune-hkf,threshold=1,3,metric=err_norm/chosen.csv"))[0]
    study = next(
        row
        for row in Results.open("results/small").summary
        if (row["case"], row["filter"], row["metric"]) == ("rate=0", "hkf", "err_norm")
    )
    assert (before["mean"], before["se"]) == (study["mean"], study["se"])


def test_the_end_of_a_range_is_told(small: Path) -> None:
    result = rkfbench("tune", small, "--filter", "hkf", "--over", "threshold=2:3", "--case", "rate=0.4", "--grid")
    assert "threshold is at the end of its range" in result.stderr


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--metric", "err_norm@k"], "is not one number a run"),
        (["--metric", "rms"], "did you mean 'rmse'"),
        (["--metric", "lambda_auc"], "does not apply to the filter 'hkf'"),
        (["--metric", "nis"], "neither a small nor a large 'nis' makes a filter better"),
        (["--metric", "mean_of(name=inflation)"], "neither a small nor a large 'mean_of(name=inflation)'"),
        (["--points", "30", "--over", "root=symmetric,cholesky", "--over", "reuse_root=true,false"], ""),
    ],
)
def test_what_cannot_be_tuned_is_said(small: Path, options: list[str], told: str) -> None:
    result = rkfbench("tune", small, "--filter", "hkf", "--over", "threshold=1:2", "--runs", "5", "--grid", *options)
    assert result.exit_code == (2 if told else 0), result.stderr
    assert told in result.stderr


def test_the_curve_of_a_root_over_the_runs_is_a_root(small: Path) -> None:
    found = tune(cell_of(small), HKF, [axis("threshold=1,2", HKF, 2)], "pooled_rmse", seed=5, runs=20)
    single = tune(cell_of(small), HKF, [axis("threshold=1,2", HKF, 2)], "mse", seed=5, runs=20)
    assert found.test_before.row["mean"] == pytest.approx(np.sqrt(single.test_before.row["mean"]))
    assert found.difference == (None, None)
