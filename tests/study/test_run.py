"""The study as a whole, on a compute part whose numbers are known: plan, resume, failures, tables."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rkfbench.errors import UsageError
from rkfbench.store import Results, files, manifest
from rkfbench.study import jobs, plan, tuning
from rkfbench.study.engines import serial
from rkfbench.study.events import BlockDone, CaseDone, Failure, Planned, Recomputing, Spoiled
from rkfbench.study.run import compute_shard, run_study
from rkfbench.study.shards import Shard
from tests.study import fakes


@pytest.fixture
def compute(monkeypatch: pytest.MonkeyPatch) -> fakes.Compute:
    return fakes.install(monkeypatch)


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()
    }


def tables(folder: Path) -> dict[str, bytes]:
    return {name: content for name, content in contents(folder).items() if name.endswith((".csv", ".yaml"))}


def run(scenario: Any, folder: Path, **options: Any) -> tuple[Any, list[Any]]:
    events: list[Any] = []
    outcome = run_study(scenario, folder, report=events.append, **options)
    return outcome, events


def reasons(events: Sequence[Any]) -> set[str]:
    return {event.reason for event in events if isinstance(event, Recomputing)}


def test_every_number_of_the_summary_has_its_formula(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    results = Results.open(tmp_path / "r")
    values = np.array([fakes.value(7, k, 0.2, "hkf") for k in range(10) if k != 3])
    rows = {row["metric"]: row for row in results.summary if (row["case"], row["filter"]) == ("rate=0.2", "hkf")}
    plain, pooled = rows["rmse"], rows["pooled_rmse"]
    assert (plain["rate"], plain["runs"], plain["failed"], plain["lost"]) == (0.2, 10, 1, 1)
    assert plain["mean"] == pytest.approx(values.mean(), rel=1e-14)
    assert plain["se"] == pytest.approx(values.std(ddof=1) / 3, rel=1e-14)
    assert plain["median"] == pytest.approx(np.median([*values, np.inf]), rel=1e-14)
    assert plain["q95"] == np.inf
    assert plain["max"] == np.inf
    assert pooled["mean"] == pytest.approx(np.sqrt(values.mean()), rel=1e-14)
    assert pooled["se"] == pytest.approx(plain["se"] / 2 / pooled["mean"], rel=1e-14)


def test_of_a_curve_that_figures_show_what_they_show_is_kept_and_any_other_is_kept_whole() -> None:
    from rkfbench.scenario.display import Curve
    from rkfbench.study.outputs import CURVE_STATISTICS, shown

    figure = Curve(kind="curve", id="fig1", metric="rmse@k", band="sd@k", cases=["rate=0.1"], filters=["kf"])
    study = fakes.scenario(filters=["kf", "hkf"], figures=(figure,))
    mean, nothing = {"mean"}, set()
    for metric, expected in (
        ("rmse@k", [mean, nothing]),
        ("sd@k", [mean, nothing]),
        ("nees@k", [CURVE_STATISTICS] * 2),
    ):
        assert [shown(study, study.cells[0], label, metric) for label in ("kf", "hkf")] == expected
        assert [shown(study, cell, "kf", metric) for cell in study.cells] == expected
    every = fakes.scenario(
        filters=["kf", "spare"], figures=(figure.model_copy(update={"cases": None, "filters": None}),)
    )
    assert [shown(every, every.cells[1], label, "rmse@k") for label in ("kf", "spare")] == [mean, nothing]
    path = figure.model_copy(update={"statistic": "first"})
    both = fakes.scenario(filters=["kf"], figures=(path, figure.model_copy(update={"metric": "sd@k", "band": None})))
    assert shown(both, both.cells[0], "kf", "rmse@k") == {"first"}
    assert shown(both, both.cells[0], "kf", "sd@k") == {"mean"}  # the band of a single path is that over all runs


def test_a_long_curve_keeps_its_ends_and_its_peaks_and_a_short_one_all() -> None:
    from rkfbench.study.outputs import CURVE_STATISTICS, MOST_STEPS, STRETCHES, thinned

    path = np.random.default_rng(8).normal(size=1500)
    path[[299, 600]] = 40.0, -40.0
    rows = [{"k": k, "mean": 0.1 * x, "se": 0.2, "median": x, "first": float(x)} for k, x in enumerate(path, 1)]
    few = thinned(rows, frozenset({"first"}))
    kept = {row["k"]: row["first"] for row in few}
    assert len(few) < MOST_STEPS
    assert all(kept[k] == path[k - 1] for k in kept)
    assert {1, 300, 601, 1500} <= kept.keys()
    for stretch in np.array_split(np.arange(1, 1501), STRETCHES):
        inside = [kept[k] for k in stretch if k in kept]
        assert (min(inside), max(inside)) == (path[stretch - 1].min(), path[stretch - 1].max())
    assert all(row["mean"] is row["se"] is row["median"] is None for row in few)
    assert thinned(rows, CURVE_STATISTICS) == rows
    short = thinned(rows[:MOST_STEPS], frozenset({"mean"}))
    assert [(row["k"], row["se"], row["first"]) for row in short] == [(k, 0.2, None) for k in range(1, MOST_STEPS + 1)]
    assert thinned([{**row, "mean": None, "se": None} for row in rows], frozenset({"mean"}))[0]["k"] == 1  # all failed


def test_a_curve_over_several_blocks_has_the_moments_of_all_runs(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    values = np.array([fakes.value(7, k, 0.1, "hkf") for k in range(10) if k != 3])
    rows = [r for r in Results.open(tmp_path / "r").series if (r["case"], r["filter"]) == ("rate=0.1", "hkf")]
    assert [row["k"] for row in rows] == [1, 2, 3]
    assert rows[2]["mean"] == pytest.approx(3 * values.mean(), rel=1e-13)
    assert rows[2]["se"] == pytest.approx(3 * values.std(ddof=1) / 3, rel=1e-13)
    assert rows[0]["median"] == pytest.approx(np.median([*values[:3], np.inf]))  # of the first block: runs 0 to 3


def test_numbers_per_run_read_back_to_the_same_bits(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    results = Results.open(tmp_path / "r")
    wanted = [np.nan if k == 3 else fakes.value(7, k, 0.1, "hkf") for k in range(10)]
    np.testing.assert_array_equal(results.values("literal", "rate=0.1", "hkf", "rmse"), wanted)
    assert results.failed("literal", "rate=0.1", "hkf").tolist() == [k == 3 for k in range(10)]
    assert results.lost("literal", "rate=0.1", "kf").tolist() == [k == 0 for k in range(10)]


def test_a_second_run_computes_nothing_and_leaves_every_byte(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    before = contents(tmp_path / "r")
    compute.calls.clear()
    outcome, events = run(fakes.scenario(), tmp_path / "r")
    assert (compute.calls, outcome.computed, outcome.changed) == ([], 0, False)
    assert (outcome.reused, events) == (6, [Planned(0)])
    assert contents(tmp_path / "r") == before


def test_adding_a_filter_computes_only_that_filter(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    before = tables(tmp_path / "r")["runs.csv"].decode().splitlines()
    compute.calls.clear()
    _, events = run(fakes.scenario(filters=["kf", "new", "hkf"]), tmp_path / "r")
    assert {labels for _, _, labels in compute.calls} == {("new",)}
    assert reasons(events) == {"filter new is not there yet"}
    after = tables(tmp_path / "r")["runs.csv"].decode().splitlines()
    assert [line for line in after if ",new," not in line] == before


def test_removing_a_filter_computes_nothing_and_takes_its_rows_away(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    compute.calls.clear()
    outcome = run_study(fakes.scenario(filters=["kf"]), tmp_path / "r")
    assert (compute.calls, outcome.changed) == ([], True)
    assert b"hkf" not in tables(tmp_path / "r")["summary.csv"]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda s: replace(s, seed=8), "seed changed"),
        (lambda s: replace(s, runs=11), "number of runs changed"),
        (lambda s: s.changed(steps=4), "scenario changed"),
        (lambda s: s.changed(metrics=["rmse"]), "metrics changed"),
        (lambda s: s.changed(filters=[{"label": "kf", "use": "ekf"}]), "filter kf changed"),
    ],
)
def test_the_reason_for_computing_again_is_told(
    tmp_path: Path, compute: fakes.Compute, change: Any, reason: str
) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    _, events = run(change(fakes.scenario()), tmp_path / "r")
    assert reasons(events) == {reason}


def test_a_change_of_the_compute_code_is_told(
    tmp_path: Path, compute: fakes.Compute, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    monkeypatch.setattr(plan, "code_hash", lambda: "another")
    _, events = run(fakes.scenario(), tmp_path / "r")
    assert reasons(events) == {"code of the compute part changed"}


def test_a_new_title_computes_nothing(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    compute.calls.clear()
    run_study(fakes.scenario(title="Another title", resolved={"name": "toy", "title": "Another title"}), tmp_path / "r")
    assert compute.calls == []
    assert "Another title" in (tmp_path / "r/scenario.yaml").read_text()


@pytest.mark.parametrize("damage", [lambda b: b[:-20], lambda b: b[:-9] + bytes([b[-9] ^ 4]) + b[-8:], lambda b: b""])
def test_a_damaged_block_is_told_and_computed_again(tmp_path: Path, compute: fakes.Compute, damage: Any) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    before = tables(tmp_path / "r")
    block = sorted((tmp_path / "r/blocks").iterdir())[1]
    block.write_bytes(damage(block.read_bytes()))
    compute.calls.clear()
    _, events = run(fakes.scenario(), tmp_path / "r")
    assert compute.calls == [(0.1, 1, ("kf", "hkf"))]
    assert reasons(events) == {f"{block} is damaged"}
    assert tables(tmp_path / "r") == before


def test_fresh_computes_everything_anew(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    before = tables(tmp_path / "r")
    compute.calls.clear()
    outcome = run_study(fakes.scenario(), tmp_path / "r", fresh=True)
    assert (outcome.computed, len(compute.calls)) == (6, 6)
    assert tables(tmp_path / "r") == before


@pytest.mark.parametrize("cut_short", [False, True], ids=["at once", "after an interruption"])
def test_fresh_numbers_under_the_same_keys_make_new_tables(
    tmp_path: Path, compute: fakes.Compute, monkeypatch: pytest.MonkeyPatch, cut_short: bool
) -> None:
    def unwritten(*_: Any) -> None:
        raise KeyboardInterrupt

    run_study(fakes.scenario(), tmp_path / "r")
    value = fakes.value
    monkeypatch.setattr(fakes, "value", lambda *args: 2 * value(*args))  # such as a plug-in that reads a file
    if cut_short:
        with monkeypatch.context() as patch:
            patch.setattr("rkfbench.study.run._write_tables", unwritten)
            with pytest.raises(KeyboardInterrupt):
                run_study(fakes.scenario(), tmp_path / "r", fresh=True)
    outcome = run_study(fakes.scenario(), tmp_path / "r", fresh=not cut_short)
    assert outcome.changed
    found = Results.open(tmp_path / "r")
    assert found.values("literal", "rate=0.2", "kf", "rmse").tolist() == [
        fakes.value(7, k, 0.2, "kf") for k in range(10)
    ]
    row = next(row for row in found.summary if (row["case"], row["filter"]) == ("rate=0.2", "kf"))
    assert row["mean"] == pytest.approx(np.mean([fakes.value(7, k, 0.2, "kf") for k in range(10)]))


def test_an_interrupted_run_keeps_its_blocks_and_resumes_to_the_same_bytes(
    tmp_path: Path, compute: fakes.Compute
) -> None:
    def interrupted(work: Sequence[jobs.Job]) -> Iterator[jobs.Done]:
        yield from list(serial(work))[:3]  # both filters of the first block, one of the second
        raise KeyboardInterrupt

    run_study(fakes.scenario(), tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run_study(fakes.scenario(), tmp_path / "r", engine=interrupted)
    assert [path.name for path in (tmp_path / "r").glob("[!.]*")] == ["blocks"]
    compute.calls.clear()
    outcome = run_study(fakes.scenario(), tmp_path / "r")
    assert (outcome.computed, outcome.reused, len(compute.calls)) == (5, 1, 5)
    assert [labels for _, _, labels in compute.calls] == [("hkf",), *[("kf", "hkf")] * 4]
    assert tables(tmp_path / "r") == tables(tmp_path / "whole")


def test_the_order_in_which_blocks_arrive_changes_no_byte(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "a")
    run_study(fakes.scenario(), tmp_path / "b", engine=lambda work: (done for done in reversed(list(serial(work)))))
    assert tables(tmp_path / "a") == tables(tmp_path / "b")


def test_a_filter_that_raises_stops_no_other(tmp_path: Path, compute: fakes.Compute) -> None:
    compute.broken = {"hkf"}
    outcome, events = run(fakes.scenario(rates=[0.1]), tmp_path / "r")
    assert [str(failure) for failure in outcome.failures] == [
        f"case rate=0.1 (literal), filter hkf, block {block}: ValueError: no such matrix" for block in range(3)
    ]
    assert [event for event in events if isinstance(event, Failure)] == list(outcome.failures)
    assert "no such matrix" in outcome.failures[0].traceback
    results = Results.open(tmp_path / "r")
    assert {row["filter"] for row in results.summary} == {"kf"}
    assert results.manifest["incomplete"] == ["rate=0.1 (literal): hkf"]

    compute.broken = set()
    compute.calls.clear()
    assert not run_study(fakes.scenario(rates=[0.1]), tmp_path / "r").failures
    assert {labels for _, _, labels in compute.calls} == {("hkf",)}
    run_study(fakes.scenario(rates=[0.1]), tmp_path / "whole")
    assert tables(tmp_path / "r") == tables(tmp_path / "whole")


def test_a_case_in_which_every_filter_raises_stops_no_other(tmp_path: Path, compute: fakes.Compute) -> None:
    def one_case(specs: Any, *args: Any) -> Any:
        if any(spec["rate"] == 0.1 for spec in specs):
            raise ValueError("no such matrix")
        return compute.together(specs, *args)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules["rkfbench.study.compute"], "together", one_case)
        outcome = run_study(fakes.scenario(), tmp_path / "r")
    assert len(outcome.failures) == 6
    results = Results.open(tmp_path / "r")
    assert {row["case"] for row in results.summary} == {"rate=0.2"}
    assert results.manifest["incomplete"] == ["rate=0.1 (literal): hkf", "rate=0.1 (literal): kf"]
    compute.broken = {"kf", "hkf"}
    run_study(fakes.scenario(), tmp_path / "none")
    assert Results.open(tmp_path / "none").summary == []
    compute.broken = set()
    for folder in ("r", "none"):
        assert not run_study(fakes.scenario(), tmp_path / folder).failures
    assert tables(tmp_path / "r") == tables(tmp_path / "none")


def test_extras_and_sensitivity_are_run_only_in_full(tmp_path: Path, compute: fakes.Compute) -> None:
    toy = fakes.scenario(filters=["kf", "spare"])
    first, second = toy.cells
    toy = replace(
        toy, cells=(first, replace(second, extra=True)), sensitivity=(replace(first, switch="cholesky root"),)
    )
    run_study(toy, tmp_path / "r")
    assert {(row["reading"], row["case"], row["filter"]) for row in Results.open(tmp_path / "r").summary} == {
        ("literal", "rate=0.1", "kf")
    }
    run_study(toy, tmp_path / "r", full=True)
    assert {(row["reading"], row["case"]) for row in Results.open(tmp_path / "r").summary} == {
        ("literal", "rate=0.1"),
        ("literal", "rate=0.2"),
        ("literal+cholesky root", "rate=0.1"),
    }
    compute.calls.clear()
    run_study(toy, tmp_path / "r")  # back to the first tier: the extras stay in their blocks
    run_study(toy, tmp_path / "r", full=True)
    assert compute.calls == []


def test_events_tell_blocks_and_cases(tmp_path: Path, compute: fakes.Compute) -> None:
    _, events = run(fakes.scenario(rates=[0.1]), tmp_path / "r")
    case = "rate=0.1 (literal)"
    assert events == [Planned(3), *3 * [BlockDone(case)], CaseDone(case, 10, 2)]


def test_a_folder_with_other_things_is_refused(tmp_path: Path, compute: fakes.Compute) -> None:
    (tmp_path / "thesis.tex").write_text("ten years")
    with pytest.raises(UsageError, match="holds other files"):
        run_study(fakes.scenario(), tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "ten years"
    assert compute.calls == []


WEB = json.dumps({"name": "my app", "icons": [{"src": "figures/photo.png"}]})


@pytest.mark.parametrize(
    "theirs",
    [
        {"manifest.json": WEB, "figures/photo.png": "", "report.md": "", "summary.csv": ""},
        {"manifest.json": '{"schema": 1, "files": {}}', "report.md": ""},
        {"manifest.json": "", "report.md": ""},
        {"manifest.json/a": "", "report.md": ""},
        {"blocks/1.block": "", "figures/photo.png": ""},
        {"blocks/1.block": "", "plugins/mine.py": ""},
        {"figures/photo.png": ""},
        {"tuning/notes.txt": ""},
    ],
    ids=lambda theirs: " ".join(theirs),
)
def test_a_folder_of_another_program_is_refused_and_stays_as_it_is(
    tmp_path: Path, compute: fakes.Compute, theirs: dict[str, str]
) -> None:
    for name, content in theirs.items():
        files.write(tmp_path / "web" / name, content)
    before = contents(tmp_path / "web")
    with pytest.raises(UsageError, match="holds other files"):
        run_study(fakes.scenario(), tmp_path / "web", fresh=True)
    assert contents(tmp_path / "web") == before


def test_a_run_that_was_cut_short_goes_on_but_not_among_other_files(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    (tmp_path / "r/manifest.json").unlink()
    files.write(tmp_path / "r/notes.txt", "mine")
    with pytest.raises(UsageError, match=r"holds other files \(notes.txt\)"):
        run_study(fakes.scenario(), tmp_path / "r")
    (tmp_path / "r/notes.txt").unlink()
    assert run_study(fakes.scenario(), tmp_path / "r").computed == 0


@pytest.mark.parametrize("end", [0, 20, 60, -1])
def test_a_manifest_that_was_cut_short_is_made_again(tmp_path: Path, compute: fakes.Compute, end: int) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    path = tmp_path / "r/manifest.json"
    path.write_text(path.read_text()[:end])
    assert run_study(fakes.scenario(), tmp_path / "r").computed == 0
    assert len(Results.open(tmp_path / "r").summary) == 8
    path.write_text(path.read_text()[:60])
    shutil.rmtree(tmp_path / "r/blocks")  # it still says whose it is
    assert run_study(fakes.scenario(), tmp_path / "r").computed == 6


def test_a_killed_first_write_leaves_a_folder_that_can_be_used(tmp_path: Path, compute: fakes.Compute) -> None:
    files.write(tmp_path / "r/blocks/.a.block.123.tmp", "half")
    assert run_study(fakes.scenario(), tmp_path / "r").computed == 6
    assert not (tmp_path / "r/blocks/.a.block.123.tmp").exists()


def test_files_of_the_user_are_neither_sealed_nor_removed(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    mine = ("mine.csv", "figures/photo.png", "tables/mine.csv", "plugins/notes.txt", "blocks/notes.txt", "report.md")
    for name in mine:
        files.write(tmp_path / "r" / name, "1")
    files.write(tmp_path / "r/figures/fig1.png", b"png")
    manifest.seal(tmp_path / "r", "figures/fig1.png")
    (tmp_path / "r/mine.csv").write_text("2")
    _, events = run(replace(fakes.scenario(), seed=8), tmp_path / "r", fresh=True)
    assert not [event for event in events if isinstance(event, Spoiled)]
    assert (tmp_path / "r/mine.csv").read_text() == "2"
    assert all((tmp_path / "r" / name).exists() for name in mine)
    assert not (tmp_path / "r/figures/fig1.png").exists()
    assert not set(mine) & set(manifest.read(tmp_path / "r")["files"])


def test_what_an_older_manifest_lists_beside_our_files_is_left_alone(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    files.write(tmp_path / "r/mine.csv", "1")
    content = json.loads((tmp_path / "r/manifest.json").read_text())
    del content[manifest.OWN]
    content["files"]["mine.csv"] = "of old"
    (tmp_path / "r/manifest.json").write_text(json.dumps(content))
    assert run_study(fakes.scenario(), tmp_path / "r").computed == 0
    assert (tmp_path / "r/mine.csv").read_text() == "1"
    assert len(Results.open(tmp_path / "r").summary) == 8


def test_a_link_to_a_folder_stays_a_link(tmp_path: Path, compute: fakes.Compute) -> None:
    for name in ("blocks", "figures"):
        (tmp_path / "scratch" / name).mkdir(parents=True)
        (tmp_path / "r").mkdir(exist_ok=True)
        (tmp_path / "r" / name).symlink_to(tmp_path / "scratch" / name)
    run_study(fakes.scenario(), tmp_path / "r")
    files.write(tmp_path / "r/figures/fig1.png", b"png")
    manifest.seal(tmp_path / "r", "figures/fig1.png")
    files.write(tmp_path / "scratch/blocks/.a.block.123.tmp", "half")
    run_study(replace(fakes.scenario(), seed=8), tmp_path / "r", fresh=True)
    assert all((tmp_path / "r" / name).is_symlink() for name in ("blocks", "figures"))
    assert len(list((tmp_path / "scratch/blocks").iterdir())) == 6
    assert list((tmp_path / "scratch/figures").iterdir()) == []


def test_a_shard_counts_blocks_as_open_that_are_out_of_date_or_not_complete(
    tmp_path: Path, compute: fakes.Compute
) -> None:
    first, second = Shard(1, 2), Shard(2, 2)
    for shard, left in ((first, 3), (second, 0)):
        assert compute_shard(fakes.scenario(filters=["kf"]), tmp_path / "r", shard).open == left
    for shard, left in ((first, 3), (second, 0)):  # the blocks are there, but without the other filter
        assert compute_shard(fakes.scenario(), tmp_path / "r", shard).open == left
    assert compute_shard(replace(fakes.scenario(), seed=8), tmp_path / "r", first).open == 3


def test_tuning_runs_of_another_study_do_not_belong_to_the_numbers(tmp_path: Path, compute: fakes.Compute) -> None:
    place = tmp_path / "r"

    def study(seed: int, choose: bool) -> Results:
        toy = fakes.scenario(seed=seed)
        run_study(toy, place)
        if choose:
            choices = [tuning.Choice(("kf", "hkf"), "rmse")]
            tuning.update(toy, choices, place, fresh=False, engine=serial, report=lambda event: None)
        tuning.tie(place, choose)
        return Results.open(place)

    with_runs = study(7, choose=True)
    assert with_runs.tuning is not None
    assert with_runs.tuning.seed == 7 + tuning.SEED_STEP
    before = (place / "manifest.json").read_bytes()
    study(7, choose=True)
    assert (place / "manifest.json").read_bytes() == before
    assert study(8, choose=False).tuning is None
    compute.calls.clear()
    assert study(7, choose=True).tuning is not None
    assert {call[0] for call in compute.calls} == {0.1, 0.2}
    assert len(compute.calls) == 6  # the blocks of the tuning runs were still there
    tuning.update(
        fakes.scenario(seed=9), [tuning.Choice(("kf",), "rmse")], place, fresh=False, engine=serial, report=id
    )
    assert Results.open(place).tuning is None


def test_the_results_of_another_scenario_are_refused(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    with pytest.raises(UsageError, match="holds the results of 'toy'"):
        run_study(fakes.scenario(name="other"), tmp_path / "r")


def test_a_full_disk_is_one_message_and_loses_no_block(
    tmp_path: Path, compute: fakes.Compute, monkeypatch: pytest.MonkeyPatch
) -> None:
    writes = []

    def fsync(handle: int) -> None:
        writes.append(handle)
        if len(writes) > 6:
            raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("rkfbench.store.files.os.fsync", fsync)
        with pytest.raises(UsageError, match="No space left on device"):
            run_study(fakes.scenario(), tmp_path / "r")
    assert len(list((tmp_path / "r/blocks").iterdir())) == 3
    assert run_study(fakes.scenario(), tmp_path / "r").reused == 3


def test_a_table_edited_by_hand_is_made_again(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    before = tables(tmp_path / "r")
    summary = tmp_path / "r/summary.csv"
    summary.write_text(summary.read_text().replace("0", "1"))
    compute.calls.clear()
    outcome, events = run(fakes.scenario(), tmp_path / "r")
    assert (outcome.computed, compute.calls) == (0, [])
    assert Spoiled(("summary.csv",)) in events
    assert tables(tmp_path / "r") == before


def test_what_others_make_in_the_folder_is_not_sealed_when_it_is_damaged(
    tmp_path: Path, compute: fakes.Compute
) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    files.write(tmp_path / "r/checks.csv", "id,deviation\na,0\n")
    manifest.seal(tmp_path / "r", "checks.csv", hashes={"checks": "abc"})
    (tmp_path / "r/checks.csv").write_text("id,deviation\na,1\n")
    run_study(fakes.scenario(), tmp_path / "r")
    assert not (tmp_path / "r/checks.csv").exists()
    assert not manifest.made_from(tmp_path / "r", "checks", "abc", "checks.csv")


def test_a_study_that_is_cut_short_closes_its_engine(tmp_path: Path, compute: fakes.Compute) -> None:
    closed = []

    def engine(work: Sequence[jobs.Job]) -> Iterator[jobs.Done]:
        try:
            yield from serial(work)
        finally:
            closed.append(True)

    def full(event: Any) -> None:
        if isinstance(event, BlockDone):
            assert not closed
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as interrupted:
        run_study(fakes.scenario(), tmp_path / "r", engine=engine, report=full)
    assert closed, interrupted  # though the traceback still holds the engine


def test_changed_numbers_take_away_what_was_drawn_from_the_old_ones(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    files.write(tmp_path / "r/claims.csv", "id\n")
    files.write(tmp_path / "r/figures/fig1.png", b"png")
    manifest.seal(tmp_path / "r", "claims.csv", "figures/fig1.png")
    run_study(replace(fakes.scenario(), seed=8), tmp_path / "r")
    assert not (tmp_path / "r/claims.csv").exists()
    assert not (tmp_path / "r/figures").exists()


def test_the_manifest_says_what_made_the_numbers(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r", facts={"argv": ["rkfbench", "run", "toy"]})
    content = json.loads((tmp_path / "r/manifest.json").read_text())
    assert (content["scenario"], content["seed"], content["runs"]) == ("toy", 7, 10)
    assert content["argv"] == ["rkfbench", "run", "toy"]
    assert content["curve_median_runs"] == 4
    assert set(content["files"]) == {"scenario.yaml", "filters.csv", "summary.csv", "series.csv", "runs.csv"}
    assert content["versions"]["numpy"] == np.__version__


def test_results_are_read_without_their_blocks(tmp_path: Path, compute: fakes.Compute) -> None:
    run_study(fakes.scenario(), tmp_path / "r")
    shutil.rmtree(tmp_path / "r/blocks")
    assert len(Results.open(tmp_path / "r").values("literal", "rate=0.1", "kf", "rmse")) == 10


def test_a_change_of_a_filter_changes_what_is_measured_against_it(tmp_path: Path, compute: fakes.Compute) -> None:
    against = fakes.scenario().changed(metrics=["rmse", "beside_kf"])
    run_study(against, tmp_path / "r")
    compute.calls.clear()
    other = [{"label": "kf", "use": "ekf"}, {"label": "hkf", "use": "hkf", "extra": False}]
    run_study(against.changed(filters=other), tmp_path / "r")
    assert {labels for _, _, labels in compute.calls} == {("kf", "hkf")}


def test_every_module_that_makes_numbers_is_in_the_hash_of_the_code() -> None:
    code = "import sys, rkfbench.study.jobs, rkfbench.study.compute; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    mine = {name.removeprefix("rkfbench.").replace(".", "/") for name in loaded if name.startswith("rkfbench.")}
    beside = {"errors", "study", "store", "store/files", "store/manifest", "store/results"}  # no number depends on them
    covered = {
        name for name in mine if any(f"{name}.py" == each or name.split("/")[0] == each for each in plan.COMPUTE)
    }
    assert mine - beside == covered
    assert all((Path(plan.__file__).parents[1] / each).exists() for each in plan.COMPUTE)


def test_the_versions_of_numpy_and_scipy_belong_to_the_hash_of_the_code(monkeypatch: pytest.MonkeyPatch) -> None:
    from importlib import metadata

    def code_with(changed: str) -> str:
        plan.code_hash.cache_clear()
        monkeypatch.setattr(metadata, "version", lambda name: "0" if name == changed else "1")
        return plan.code_hash()

    assert len({code_with(name) for name in ("", "numpy", "scipy")}) == 3
    plan.code_hash.cache_clear()
