"""Two results folders side by side, where the truth about their difference is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rkfbench.compare import compare
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
    manifest.seal(folder, scenario="toy", seed=seed, runs=RUNS)
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
    manifest.seal(folder, scenario="toy", seed=seed, runs=runs)
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
    assert compare(folder("a", 1, 1.0), folder("b", 2, 0.0)).level == "different"
