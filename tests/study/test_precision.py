"""Precision on demand: where a study stops is a function of its numbers, and everyone who judges it is told."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rkfbench.errors import UsageError
from rkfbench.filters import FILTERS
from rkfbench.references import is_reference
from rkfbench.scenario import bundled, load
from rkfbench.store import Results
from rkfbench.study.engines import serial
from rkfbench.study.events import Stopped
from rkfbench.study.precision import Goal, relative_error
from rkfbench.study.run import Outcome, run_study
from tests.study import fakes
from tests.test_recording import EXAMPLE

REFERENCES = ["clairvoyant_kf", "kf_clair", "truth", "zero", "bayes"]  # of the catalogue


@pytest.fixture
def compute(monkeypatch: pytest.MonkeyPatch) -> fakes.Compute:
    return fakes.install(monkeypatch)


def values(study: fakes.Scenario, label: str, runs: int) -> Any:
    found = [[fakes.value(study.seed, k, cell.spec["rate"], label) for k in range(runs)] for cell in study.cells]
    return np.array([np.delete(each, 3) if label == "hkf" else each for each in found])  # run 3 of hkf fails


def expected_runs(study: fakes.Scenario, labels: list[str], goal: float, most: int) -> int:
    """The rule by brute force: block after block, all cases and filters."""
    for runs in range(fakes.BLOCK, most, fakes.BLOCK):
        errors = []
        for label in labels:
            each = values(study, label, runs)
            errors += list(each.std(axis=1, ddof=1) / math.sqrt(each.shape[1]) / each.mean(axis=1))
        if max(errors) <= goal:
            return runs
    return most


def run(study: Any, folder: Path, goal: Goal, **options: Any) -> tuple[Outcome, list[str]]:
    events: list[Any] = []
    outcome = run_study(study, folder, goal=goal, report=events.append, **options)
    return outcome, [event.text for event in events if isinstance(event, Stopped)]


@pytest.mark.parametrize("goal", [0.4, 0.2, 0.1])
def test_a_study_stops_at_the_first_end_of_a_block_where_all_are_precise(
    tmp_path: Path, compute: fakes.Compute, goal: float
) -> None:
    study = fakes.scenario()
    outcome, said = run(study, tmp_path / "r", Goal({"rmse": goal}, 1000))
    assert outcome.runs == expected_runs(study, ["kf", "hkf"], goal, 1000) < 1000
    results = Results.open(tmp_path / "r")
    assert {row["runs"] for row in results.summary} == {outcome.runs}
    assert results.manifest["precision"]["runs"] == outcome.runs
    assert results.manifest["precision"]["largest"] <= goal
    assert said == [results.stopped]
    assert f"stopped at {outcome.runs} runs: precision rmse={goal:g} reached" in results.stopped


def test_the_results_are_those_of_the_study_with_that_number_of_runs(tmp_path: Path, compute: fakes.Compute) -> None:
    study = fakes.scenario()
    outcome, _ = run(study, tmp_path / "r", Goal({"rmse": 0.15}, 1000))
    run_study(replace(study, runs=outcome.runs), tmp_path / "fixed")
    for name in ("summary.csv", "series.csv", "runs.csv"):
        assert (tmp_path / "r" / name).read_bytes() == (tmp_path / "fixed" / name).read_bytes()
    assert Results.open(tmp_path / "fixed").stopped == ""


def test_neither_order_nor_what_is_there_changes_where_it_stops(tmp_path: Path, compute: fakes.Compute) -> None:
    study, goal = fakes.scenario(), Goal({"rmse": 0.15}, 1000)
    first, _ = run(study, tmp_path / "a", goal)
    run_study(replace(study, runs=200), tmp_path / "b")  # far beyond the stop
    second, _ = run(study, tmp_path / "b", goal, engine=lambda work: reversed(list(serial(work))))
    assert second.runs == first.runs
    for name in ("summary.csv", "series.csv", "runs.csv", "scenario.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_second_run_computes_nothing_and_a_fixed_number_takes_the_mark_away(
    tmp_path: Path, compute: fakes.Compute
) -> None:
    study, goal = fakes.scenario(), Goal({"rmse": 0.2}, 1000)
    first, _ = run(study, tmp_path / "r", goal)
    compute.calls.clear()
    second, said = run(study, tmp_path / "r", goal)
    assert (compute.calls, second.runs, second.changed, len(said)) == ([], first.runs, False, 1)
    resolved = {**study.resolved, "runs": {"paper": first.runs, "reference": first.runs}}
    assert run_study(replace(study, runs=first.runs, resolved=resolved), tmp_path / "r").changed
    assert Results.open(tmp_path / "r").stopped == ""


def test_max_runs_ends_it_and_says_so(tmp_path: Path, compute: fakes.Compute) -> None:
    outcome, (said,) = run(fakes.scenario(), tmp_path / "r", Goal({"rmse": 1e-6}, 30))
    assert outcome.runs == 30
    assert "stopped at 30 runs: precision rmse=1e-06 not reached (farthest: relative standard error 0." in said


def test_extras_and_references_are_not_asked(tmp_path: Path, compute: fakes.Compute) -> None:
    ranked = fakes.scenario(filters=["hkf"])
    alone, _ = run(ranked, tmp_path / "alone", Goal({"rmse": 0.3}, 1000))
    beside = fakes.scenario(filters=["hkf", "spare", *REFERENCES])
    outcome, _ = run(beside, tmp_path / "r", Goal({"rmse": 0.3}, 1000), full=True)
    assert outcome.runs == alone.runs == expected_runs(ranked, ["hkf"], 0.3, 1000)


def test_a_filter_that_knows_more_than_the_others_is_a_reference() -> None:
    more = [name for name, entry in FILTERS.items() if entry.needs & {"record", "flags", "truth"}]
    assert all(map(is_reference, [*REFERENCES, *more]))
    assert [name for name in FILTERS if is_reference(name) and name not in REFERENCES] == []


def test_a_label_makes_no_reference(tmp_path: Path, compute: fakes.Compute) -> None:
    study = fakes.scenario(filters=["hkf"])
    spec = {"filters": [{"use": "hkf", "label": label} for label in ("optimal_hkf", "zero_lag", "truth")]}
    for label in ("optimal_hkf", "zero_lag", "truth"):
        assert run(study.changed(filters=spec["filters"]), tmp_path / label, Goal({"rmse": 0.3}, 1000))[0].runs > 0
    assert not any(map(is_reference, spec["filters"]))
    assert is_reference({"label": "mine", "use": "bayes", "points": 100})
    assert is_reference({"label": "mine", "fixed_point": {"filter": {"use": "clairvoyant_kf"}, "at": 5}})
    assert is_reference({"label": "mine", "use": "rts", "filter": "clairvoyant_kf"})
    assert not is_reference({"label": "truth", "moments": "taylor", "weight": {"huber": {"threshold": 1.0}}})
    assert not is_reference({"label": "mine", "use": "mine.py:mine", "start": "zero"})


def test_the_references_of_the_bundled_scenarios() -> None:
    specs = [spec for name in bundled() for cell in load(name).cells for spec in cell.spec["filters"]]
    found = {spec["label"] for spec in specs if is_reference(spec)}
    assert found == {"bayes", "clairvoyant_kf", "clairvoyant_ks", "kf_clair", "truth", "zero"}


def test_a_study_of_references_alone_is_refused_before_it_begins(small: Path) -> None:
    small.write_text(small.read_text().replace("[kf, {use: hkf, threshold: 2}]", "[clairvoyant_kf, zero]"))
    with pytest.raises(UsageError, match="compares no filters, it has references and extras only"):
        Goal.of(["0.01"], 5, load(small))


def test_a_filter_that_raises_stops_the_search(tmp_path: Path, compute: fakes.Compute) -> None:
    compute.broken = {"hkf"}
    outcome, said = run(fakes.scenario(), tmp_path / "r", Goal({"rmse": 0.2}, 1000))
    assert outcome.failures and not said
    assert outcome.runs == fakes.BLOCK


def test_a_relative_error_that_is_infinite_is_null_in_the_manifest(tmp_path: Path, compute: fakes.Compute) -> None:
    run(fakes.scenario(), tmp_path / "r", Goal({"rmse": 0.01}, 1))
    assert Results.open(tmp_path / "r").manifest["precision"]["largest"] is None


def test_recorded_data_has_a_number_of_runs_of_its_own() -> None:
    with pytest.raises(UsageError, match="chooses the number of runs, and recorded data has its own"):
        Goal.of(["0.01"], 5, load(EXAMPLE))


def test_relative_error_of_what_has_none() -> None:
    assert relative_error(np.array([1.0, np.nan])) == math.inf
    assert relative_error(np.array([1.0, -1.0])) == math.inf
    assert relative_error(np.array([0.0, 0.0])) == 0.0
    assert relative_error(np.array([1.0, 3.0, np.nan])) == pytest.approx(0.5)


def test_the_goal_is_about_the_score_or_the_metric_named() -> None:
    study = fakes.scenario().changed(metrics=["rmse", "score"])
    assert Goal.of(["0.01"], None, study) == Goal({"score": 0.01}, 100_000)
    assert Goal.of(["0.01", "rmse=0.1"], 500, study) == Goal({"score": 0.01, "rmse": 0.1}, 500)
    assert Goal.of(["0.01"], None, fakes.scenario()) == Goal({"rmse": 0.01}, 100_000)
    assert Goal.of(["0.01"], None, study.changed(metrics=["mse"], score="mse")) == Goal({"mse": 0.01}, 100_000)
    without = study.changed(metrics=["err_norm@k", "mse", "err_norm"])
    assert Goal.of(["0.01"], None, without) == Goal({"mse": 0.01}, 100_000)


@pytest.mark.parametrize("text", ["0", "-1", "much", "rmse=", "rmse=nan", "inf"])
def test_a_goal_that_is_no_positive_number_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="a positive number"):
        Goal.of([text], None, fakes.scenario())


def test_a_metric_that_is_not_measured_is_refused_with_those_that_are() -> None:
    with pytest.raises(UsageError, match=r"does not measure rms: .* one of err_norm, pooled_rmse"):
        Goal.of(["rms=0.1"], None, fakes.scenario().changed(metrics=["err_norm", "pooled_rmse", "err_norm@k"]))
