"""Two results folders side by side, where the truth about their difference is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rkfbench.compare import chance, compare
from rkfbench.compare.chance import Sample, Skew
from rkfbench.compare.pair import Pair
from rkfbench.compare.tested import counts
from rkfbench.store import Results, files, manifest
from rkfbench.study.summary import summarise

RUNS = 400


def draw(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(RUNS)


def results(folder: Path, filters: Mapping[str, np.ndarray], seed: int = 7, per_run: bool = True) -> Results:
    """A sealed folder whose filters have these values of the metric rmse."""
    counts = {"runs": RUNS, "failed": 0, "lost": 0}
    rows = [
        {"reading": "a", "case": "", "filter": label, "metric": "rmse", **counts}
        | summarise(values, np.zeros(len(values), bool))
        for label, values in filters.items()
    ]
    files.write_records(folder / "summary.csv", list(rows[0]), rows)
    if per_run:
        lines = [["a", "", run, label, 0, 0, values[run]] for run in range(RUNS) for label, values in filters.items()]
        files.write_csv(folder / "runs.csv", ["reading", "case", "run", "filter", "failed", "lost", "rmse"], lines)
    manifest.seal(folder, *manifest.TOP, scenario="toy", seed=seed, runs=RUNS)
    return Results.open(folder)


def test_equal_files_are_the_same_bytes(tmp_path: Path) -> None:
    a, b = (results(tmp_path / name, {"kf": draw(1)}) for name in "ab")
    assert compare(a, b).level == "same bytes"


def test_a_reference_without_numbers_per_run_can_be_the_same_bytes(tmp_path: Path) -> None:
    a = results(tmp_path / "a", {"kf": draw(1)})
    b = results(tmp_path / "b", {"kf": draw(1)}, per_run=False)
    assert compare(a, b).level == "same bytes"


@pytest.mark.parametrize(("change", "level"), [(1e-12, "same to the tolerance"), (1e-6, "different")])
def test_the_last_bits_are_within_the_tolerance(tmp_path: Path, change: float, level: str) -> None:
    a, b = results(tmp_path / "a", {"kf": draw(1)}), results(tmp_path / "b", {"kf": draw(1) * (1 + change) + change})
    assert compare(a, b).level == level


def test_other_seeds_differ_by_chance_only(tmp_path: Path) -> None:
    levels = []
    for k in range(40):
        a = results(tmp_path / f"a{k}", {label: draw(100 * k + i) for i, label in enumerate("stuvwxyz")}, 1, False)
        b = results(
            tmp_path / f"b{k}", {label: draw(5000 + 100 * k + i) for i, label in enumerate("stuvwxyz")}, 2, False
        )
        levels.append(compare(a, b).level)
    assert levels.count("different") <= 8  # 5 % of 40 in the mean: more than 8 has probability 1e-4


def test_runs_of_the_same_seed_are_compared_in_pairs(tmp_path: Path) -> None:
    shifted = {"kf": draw(1) + 0.02 * draw(2) + 0.01}  # far below the standard error 0.05 of a mean, 10 of a pair
    a = results(tmp_path / "a", {"kf": draw(1)})
    assert compare(a, results(tmp_path / "b", shifted)).level == "different"
    assert compare(a, results(tmp_path / "c", shifted, seed=8)).level == "no statistical difference"
    assert compare(a, results(tmp_path / "d", shifted, per_run=False)).level == "no statistical difference"


def test_rows_of_one_folder_alone_are_differences_unless_only_common_ones_count(tmp_path: Path) -> None:
    a, b = results(tmp_path / "a", {"kf": draw(1)}), results(tmp_path / "b", {"kf": draw(1), "hkf": draw(2)})
    found = compare(a, b)
    assert found.level == "different"
    assert [(each.key[2], each.a, each.b is None) for each in found.differences] == [("hkf", None, False)]
    assert compare(a, b, common=True).level == "same to the tolerance"


def tracking(folder: Path, runs: int, tracked: int, seed: int) -> Results:
    """A folder with one mean over the runs that are not lost, of which there may be none."""
    row = {"reading": "a", "case": "", "filter": "pf", "metric": "tracking_mse", "runs": runs, "failed": 1}
    lost = {"lost": runs - tracked}
    statistics = summarise(np.random.default_rng(seed).standard_normal(tracked), np.zeros(tracked, bool))
    files.write_records(folder / "summary.csv", list(row | lost | statistics), [row | lost | statistics])
    manifest.seal(folder, *manifest.TOP, scenario="toy", seed=seed, runs=runs)
    return Results.open(folder)


@pytest.mark.parametrize(("tracked", "level"), [(9, "no statistical difference"), (900, "different")])
def test_a_mean_over_no_run_that_tracks_is_judged_by_how_many_track(tmp_path: Path, tracked: int, level: str) -> None:
    few, many = tracking(tmp_path / "a", 100, 0, 1), tracking(tmp_path / "b", 2000, tracked, 2)
    assert compare(few, many).level == level
    assert compare(many, few).level == level


def test_a_number_that_vanished_from_runs_that_track_is_a_difference(tmp_path: Path) -> None:
    some, none = (
        results(tmp_path / name, {"kf": draw(1) * factor}, 7, False) for name, factor in (("a", 1), ("b", np.nan))
    )
    assert compare(some, none).level == "different"


def test_means_that_overflow_are_judged_by_medians(tmp_path: Path) -> None:
    def folder(name: str, seed: int, shift: float) -> Results:
        values = draw(seed) + shift
        values[:2] = np.inf if name == "a" else 1e300
        return results(tmp_path / f"{name}{shift}", {"kf": values}, seed, False)

    assert compare(folder("a", 1, 0.0), folder("b", 2, 0.0)).level == "no statistical difference"
    assert compare(folder("a", 1, 2.5), folder("b", 2, 0.0)).level == "different"


def study(
    folder: Path, values: np.ndarray, failed: np.ndarray, seed: int = 7, per_run: bool = True, losing: bool = True
) -> Results:
    """A folder with the metric rmse of one filter in cases 0, 1, ..: values and failed (cases, runs).

    losing: whether the scenario says when a run is lost, as failed ones are.
    """
    rows, lines = [], []
    for case, (x, dead) in enumerate(zip(values, failed, strict=True)):
        counts = {"runs": len(x), "failed": int(dead.sum()), "lost": int(losing and dead.sum())}
        key = {"reading": "a", "case": str(case), "filter": "kf", "metric": "rmse"}
        rows.append(key | counts | summarise(x, dead))
        lines += [
            ["a", case, i, "kf", int(d), int(d and losing), "nan" if d else v]
            for i, (v, d) in enumerate(zip(x, dead, strict=True))
        ]
    files.write_records(folder / "summary.csv", list(rows[0]), rows)
    if per_run:
        files.write_csv(folder / "runs.csv", ["reading", "case", "run", "filter", "failed", "lost", "rmse"], lines)
    manifest.seal(folder, *manifest.TOP, scenario="toy", seed=seed, runs=values.shape[1])
    return Results.open(folder)


@pytest.mark.parametrize("per_run", [True, False])
def test_failed_runs_alone_make_a_difference(tmp_path: Path, per_run: bool) -> None:
    values, none = np.random.default_rng(3).standard_normal((4, 30)), np.zeros((4, 30), bool)
    some = none.copy()
    some[:, ::5] = some[:, 1::5] = True
    a = study(tmp_path / "a", values, none)
    found = compare(a, study(tmp_path / "b", values, some, per_run=per_run))
    assert found.level == "different"
    assert {each.key[3] for each in found.differences} == {"failed", "lost"}
    one = none.copy()
    one[0, 3] = True
    assert compare(a, study(tmp_path / "c", values, one, per_run=per_run)).level == "no statistical difference"


@pytest.mark.parametrize("per_run", [True, False])
def test_failed_runs_are_no_lost_ones_where_the_scenario_has_no_such_thing(tmp_path: Path, per_run: bool) -> None:
    values, none = np.random.default_rng(3).standard_normal((4, 30)), np.zeros((4, 30), bool)
    some = none.copy()
    some[:, ::2] = True
    a, b = (
        study(tmp_path / name, values, dead, per_run=per_run, losing=False) for name, dead in (("a", none), ("b", some))
    )
    assert "lost" not in {each.key[3] for each in compare(a, b).differences}
    assert {each.key[3] for each in counts(Pair(a, b))} == {"failed"}  # the family has no test of nothing


def many(rng: np.random.Generator, runs: int) -> np.ndarray:
    """Six rows each of a normal law, of laws skew to the right and to the left, and of one with few values."""
    skew = rng.lognormal(0, 1.5, (12, runs))
    return np.concatenate([rng.standard_normal((6, runs)), skew[:6], -skew[6:], rng.poisson(3, (6, runs))])


@pytest.mark.parametrize(
    ("runs", "others", "kept"),
    [(5, 5, "paired"), (20, 20, "paired"), (20, 20, "first"), (5, 300, "first"), (20, 300, "first"), (20, 300, "none")],
)
def test_chance_alone_is_seldom_called_a_difference(runs: int, others: int, kept: str, tmp_path: Path) -> None:
    """Two studies of the same laws: 5 % may differ; more than 4 of 20 has probability 0.003."""
    rng, levels = np.random.default_rng(11), []
    for k in range(20):
        x, y = many(rng, runs), many(rng, others)
        if kept == "paired":
            of_the_run = rng.standard_normal(x.shape)
            x, y = of_the_run + 0.1 * x, of_the_run + 0.1 * y
        a = study(tmp_path / f"a{k}", x, np.zeros(x.shape, bool), 1, kept != "none")
        b = study(tmp_path / f"b{k}", y, np.zeros(y.shape, bool), 1 if kept == "paired" else 2, kept == "paired")
        levels.append(compare(a, b).level)
    assert levels.count("different") <= 4


def test_medians_that_differ_are_seen_where_a_mean_is_that_of_one_run(tmp_path: Path) -> None:
    x, sound = np.random.default_rng(5).lognormal(0, 0.3, (3, 30)), np.zeros((3, 30), bool)
    y = 3 * x
    x[:, 7], y[:, 7] = 1e12, 2e12
    a = study(tmp_path / "a", x, sound)
    for name, seed, per_run in (("pairs", 7, True), ("others", 8, True), ("summary", 7, False)):
        found = compare(a, study(tmp_path / name, y, sound, seed, per_run))
        assert found.level == "different", name
        assert {each.what for each in found.differences} == {"median"}


@pytest.mark.parametrize(("seed", "per_run"), [(7, True), (8, True), (7, False)])
def test_medians_and_shares_of_infinite_values_are_compared(tmp_path: Path, seed: int, per_run: bool) -> None:
    rng, sound = np.random.default_rng(5), np.zeros((1, 400), bool)
    x, y = rng.normal(50, 5, (1, 400)), rng.normal(50, 5, (1, 400))
    x[:, :40] = y[:, 20:60] = np.inf
    a = study(tmp_path / "a", x, sound)
    assert compare(a, study(tmp_path / "b", y, sound, seed, per_run)).level == "no statistical difference"
    assert compare(a, study(tmp_path / "c", y + 10, sound, seed, per_run)).level == "different"
    if per_run:
        y[:, :160] = np.inf
        found = compare(a, study(tmp_path / "d", y, sound, seed))
        assert "infinite" in {each.what for each in found.differences}


def whole(folder: Path, factor: float = 1.0, deviation: float = 1e-12, threshold: float = 1.345) -> Results:
    """A folder with one row, a curve of 100 runs, a check and a filter."""
    results(folder, {"hkf": draw(1)})
    key = {"reading": "a", "case": "", "filter": "hkf", "metric": "rmse@k"}
    steps = [key | {"k": k, "mean": factor * (1 + k), "se": factor * 0.01, "median": None, "first": k} for k in (1, 2)]
    files.write_records(folder / "series.csv", list(steps[0]), steps)
    check = {"id": "toy.E1", "deviation": deviation, "tolerance": 1e-9, "note": f"deviates by {deviation}"}
    files.write_records(folder / "checks.csv", list(check), [check])
    filt = {"label": "hkf", "name": "hkf", "threshold": threshold, "root": "symmetric"}
    files.write_records(folder / "filters.csv", list(filt), [filt])
    manifest.seal(folder, *manifest.TOP, scenario="toy", seed=7, runs=RUNS)
    return Results.open(folder)


@pytest.mark.parametrize(
    ("changed", "level"),
    [
        ({"factor": 1 + 1e-12, "deviation": 2e-12}, "same to the tolerance"),
        ({"factor": 1 + 1e-6}, "no statistical difference"),
        ({"factor": 10.0}, "different"),
        ({"deviation": 1e6}, "different"),
        ({"threshold": 1.5}, "no statistical difference"),
    ],
)
def test_curves_checks_and_filters_are_compared(tmp_path: Path, changed: dict[str, float], level: str) -> None:
    a, b = whole(tmp_path / "a"), whole(tmp_path / "b", **changed)
    assert compare(a, b).level == compare(b, a, common=True).level == level


def test_curves_and_checks_of_one_folder_alone_are_differences_unless_only_common_ones_count(tmp_path: Path) -> None:
    a, b = whole(tmp_path / "a"), results(tmp_path / "b", {"hkf": draw(1)})
    assert {each.what for each in compare(a, b).differences} == {"curve", "check"}
    assert compare(a, b, common=True).level == "same bytes"


def test_few_runs_that_agree_in_one_value_may_do_so_by_chance() -> None:
    """A coin that fell heads five times here and tails there: one in five hundred, and a study has many rows."""
    limit = chance.threshold(200, 0.05)
    for runs, seen in ((5, False), (400, True)):
        paired = chance.paired(np.ones(runs), np.zeros(runs))
        apart = float(chance.means(Sample(runs, 1.0, 0.0), Sample(runs, 0.0, 0.0), Skew(0.0, 0.0)))
        assert [0 < z < limit for z in (paired, apart)] == [not seen] * 2
        assert [z > limit for z in (paired, apart)] == [seen] * 2
