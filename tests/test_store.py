"""The results folder: whole files, one run at a time, nothing believed that is not what was written."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rkfbench.errors import UsageError
from rkfbench.store import Results, blocks, files, manifest
from rkfbench.store.blocks import Curve, Damaged, Part
from rkfbench.store.lock import locked
from rkfbench.store.results import read_once


def folder(path: Path) -> Path:
    """A small sealed results folder."""
    rows = [
        ["literal", "5", 0, "kf", 0, 0, 0.1],
        ["literal", "5", 1, "kf", 1, 0, None],
        ["literal", "5", 2, "kf", 0, 1, 0.3],
    ]
    files.write_csv(path / "runs.csv", ["reading", "case", "run", "filter", "failed", "lost", "rmse"], rows)
    files.write_csv(
        path / "summary.csv", ["reading", "case", "filter", "metric", "mean"], [["literal", "5", "kf", "rmse", 0.2]]
    )
    files.write_csv(path / "checks.csv", ["id", "deviation", "tolerance"], [["aladkf.T1", 1e-12, 1e-9]])
    files.write_csv(path / "timings/table.csv", ["case", "filter", "ms"], [["5", "kf", 14.2]])
    manifest.seal(path, *manifest.TOP, "timings/table.csv", scenario="toy", seed=7, runs=3)
    return path


def test_a_label_in_a_file_name_is_short_and_no_other_label() -> None:
    assert files.slug("filters.hkf.threshold=0.5:3:6") == "filters.hkf.threshold=0.5-3-6"
    assert files.slug("/") == "data"
    long = [files.slug("β" * 100 + end) for end in "ab"]
    assert len(set(long)) == 2
    assert all(len(name.encode()) <= files.LONGEST + 7 for name in long)


def test_a_failed_write_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    files.write(tmp_path / "a.csv", "old")

    def rows() -> Any:
        yield [1]
        raise RuntimeError

    with pytest.raises(RuntimeError):
        files.write_csv(tmp_path / "a.csv", ["x"], rows())
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"a.csv": "old"}


@pytest.mark.parametrize("name", ["file/a.csv", "file"])
def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, name: str) -> None:
    (tmp_path / "file").mkdir() if name == "file" else (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot write .*file.*: (Not|Is) a directory|cannot write .*: File exists"):
        files.write(tmp_path / name, "x")


@given(st.lists(st.floats(), max_size=5))
def test_floats_read_back_to_the_same_bits(tmp_path_factory: pytest.TempPathFactory, numbers: list[float]) -> None:
    path = tmp_path_factory.mktemp("csv") / "a.csv"
    files.write_csv(path, ["x"], [[number] for number in numbers])
    back = [float(row["x"]) for row in files.read_records(path)]
    assert [math.isnan(x) or x.hex() for x in back] == [math.isnan(x) or x.hex() for x in numbers]


def test_csv_has_one_dialect(tmp_path: Path) -> None:
    files.write_csv(tmp_path / "a.csv", ["x", "y"], [[0.1, None], [math.nan, "a, b"], [1, "é"]])
    assert (tmp_path / "a.csv").read_bytes() == 'x,y\n0.1,\nnan,"a, b"\n1,é\n'.encode()


def test_names_stay_text_and_numbers_become_numbers(tmp_path: Path) -> None:
    files.write_csv(tmp_path / "a.csv", ["case", "k", "mean", "se", "note"], [["5", 5, 0.5, None, "five"]])
    assert files.read_records(tmp_path / "a.csv") == [{"case": "5", "k": 5, "mean": 0.5, "se": None, "note": "five"}]


def part(seed: int = 0) -> Part:
    draw = np.random.default_rng(seed)
    failed = np.array([False, True, False])
    curve = Curve.of(np.arange(1, 5), draw.standard_normal((4, 3)), failed)
    return Part(
        failed, ~failed, {"rmse": draw.standard_normal(3), "b/c": np.array([1.0, np.nan, np.inf])}, {"rmse@k": curve}
    )


def test_a_block_reads_back_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "x.block"
    blocks.write(path, {"kf": ({"seed": 1}, part(1)), "../h.npy": ({"seed": 2}, part(2))})
    assert blocks.keys(path) == {"kf": {"seed": 1}, "../h.npy": {"seed": 2}}
    for label, seed in (("kf", 1), ("../h.npy", 2)):
        back, wanted = blocks.read(path, {label})[label], part(seed)
        np.testing.assert_array_equal(back.failed, wanted.failed)
        np.testing.assert_array_equal(back.lost, wanted.lost)
        assert (list(back.values), list(back.curves)) == (list(wanted.values), list(wanted.curves))
        np.testing.assert_array_equal(list(back.values.values()), list(wanted.values.values()))
        np.testing.assert_array_equal(back.curves["rmse@k"], wanted.curves["rmse@k"])


def test_every_flipped_bit_and_every_cut_of_a_block_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "x.block"
    blocks.write(path, {"kf": ({"seed": 1}, part())})
    whole = path.read_bytes()
    draw = np.random.default_rng(1)
    for place in draw.integers(0, len(whole), 100).tolist():
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << int(draw.integers(8))]) + whole[place + 1 :])
        with pytest.raises(Damaged):
            blocks.keys(path)
        path.write_bytes(whole[:place])
        with pytest.raises(Damaged):
            blocks.keys(path)


def test_merged_moments_are_those_of_all_runs() -> None:
    draw = np.random.default_rng(3)
    paths, failed = 1e6 + draw.standard_normal((5, 30)), draw.random(30) < 0.2
    failed[20:] = True  # the last block has no good run
    pieces = [Curve.of(np.arange(5), paths[:, a:b], failed[a:b]) for a, b in ((20, 30), (0, 7), (7, 20))]
    merged = pieces[0].merge(pieces[1]).merge(pieces[2])
    good = paths[:, ~failed]
    np.testing.assert_array_equal(merged.n, good.shape[1])
    np.testing.assert_allclose(merged.mean, good.mean(1), rtol=1e-14)
    np.testing.assert_allclose(merged.m2, ((good - good.mean(1, keepdims=True)) ** 2).sum(1), rtol=1e-8)


def test_a_curve_leaves_out_the_runs_that_are_not_defined_at_a_step() -> None:
    draw = np.random.default_rng(3)
    paths, failed = draw.standard_normal((5, 30)), np.arange(30) == 4
    paths[draw.random((5, 30)) < 0.6] = np.nan
    paths[1], paths[2, :20] = np.nan, np.nan  # nowhere defined; nowhere in the first blocks
    pieces = [Curve.of(np.arange(5), paths[:, a:b], failed[a:b]) for a, b in ((0, 7), (7, 20), (20, 30))]
    merged = pieces[0].merge(pieces[1]).merge(pieces[2])
    whole = Curve.of(np.arange(5), paths, failed)
    good = paths[:, ~failed]
    for step in (0, 2, 3, 4):
        defined = good[step, ~np.isnan(good[step])]
        for curve in (merged, whole):
            assert curve.n[step] == len(defined) > 0
            assert curve.mean[step] == pytest.approx(defined.mean())
            assert curve.m2[step] == pytest.approx(defined.var() * len(defined))
        assert whole.median[step] == np.median([*defined, np.inf])
    assert merged.n[1] == whole.n[1] == merged.m2[1] == 0
    assert np.isnan(merged.mean[1]) and np.isnan(whole.mean[1])


def test_results_are_what_was_written(tmp_path: Path) -> None:
    results = Results.open(folder(tmp_path / "r"))
    assert (results.scenario, results.seed, results.runs) == ("toy", 7, 3)
    np.testing.assert_array_equal(results.values("literal", "5", "kf", "rmse"), [0.1, np.nan, 0.3])
    assert results.failed("literal", "5", "kf").tolist() == [False, True, False]
    assert results.lost("literal", "5", "kf").tolist() == [False, True, True]  # a failed run is lost too
    assert results.summary == [{"reading": "literal", "case": "5", "filter": "kf", "metric": "rmse", "mean": 0.2}]
    assert results.check("aladkf.T1") == (1e-12, 1e-9)
    assert results.timings == {"table": [{"case": "5", "filter": "kf", "ms": 14.2}]}
    assert results.claims == []
    with pytest.raises(KeyError):
        results.values("literal", "5", "hkf", "rmse")
    with pytest.raises(KeyError):
        results.values("literal", "5", "kf", "mse")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda r: (r / "summary.csv").write_text("mean\n1.0\n"), r"summary\.csv is not what rkfbench wrote"),
        (lambda r: (r / "runs.csv").write_bytes((r / "runs.csv").read_bytes()[:-1]), r"runs\.csv is not what"),
        (lambda r: (r / "timings/table.csv").unlink(), r"timings/table\.csv is missing"),
        (lambda r: (r / "manifest.json").unlink(), "is not a results folder"),
        (lambda r: (r / "manifest.json").write_text("{"), r"manifest\.json is damaged"),
        (lambda r: (r / "manifest.json").write_text("[]"), r"schema version None"),
        (lambda r: (r / "manifest.json").write_text('{"schema": 99}'), r"schema version 99, this rkfbench reads"),
    ],
)
def test_results_that_are_not_whole_are_named_and_refused(tmp_path: Path, spoil: Any, message: str) -> None:
    spoil(folder(tmp_path / "r"))
    with pytest.raises(UsageError, match=message):
        Results.open(tmp_path / "r")


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="nowhere: no such results folder"):
        Results.open(tmp_path / "nowhere")


def test_without_numbers_per_run_the_rest_is_still_read(tmp_path: Path) -> None:
    (folder(tmp_path / "r") / "runs.csv").unlink()
    manifest.seal(tmp_path / "r")
    results = Results.open(tmp_path / "r")
    assert (results.has_runs, len(results.summary)) == (False, 1)
    with pytest.raises(UsageError, match="keeps no numbers per run"):
        results.values("literal", "5", "kf", "rmse")


def test_sealing_again_changes_the_manifest_only_with_a_file(tmp_path: Path) -> None:
    path = folder(tmp_path / "r")
    before = (path / "manifest.json").read_bytes()
    assert not manifest.seal(path, finished="later")
    assert (path / "manifest.json").read_bytes() == before
    files.write(path / "claims.csv", "claim\nC1\n")
    assert manifest.seal(path, "claims.csv")
    content = json.loads((path / "manifest.json").read_text())
    assert "claims.csv" in content["files"]
    assert content["seed"] == 7
    assert Results.open(path).claims == [{"claim": "C1"}]


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    with locked(tmp_path / "r"):
        other = multiprocessing.get_context("spawn").Process(target=_lock_and_leave, args=(tmp_path / "r",))
        other.start()
        other.join()
        assert other.exitcode == 42
    with locked(tmp_path / "r"):  # free again
        pass
    assert list((tmp_path / "r").iterdir()) == []


def _lock_and_leave(path: Path) -> None:
    try:
        with locked(path):
            os._exit(0)
    except UsageError as error:
        os._exit(42 if "in use by another run" in str(error) else 1)


def test_the_lock_and_the_pieces_of_a_killed_run_are_no_obstacle(tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from rkfbench.store.lock import locked\n"
        "with locked(Path(sys.argv[1])): print('locked', flush=True); time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path / "r")], stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "locked\n"
        other.send_signal(signal.SIGKILL)
    (tmp_path / "r/.summary.csv.123.tmp").write_text("half")
    with locked(tmp_path / "r"):
        assert [path.name for path in (tmp_path / "r").iterdir()] == [".lock"]


@pytest.mark.parametrize("name", ["summary.csv", "checks.csv", "timings/table.csv"])
def test_spoiled_files_are_named_and_no_longer_stand_for_what_they_were_made_from(tmp_path: Path, name: str) -> None:
    path = folder(tmp_path / "r")
    manifest.seal(path, hashes={"part": "abc"})
    assert manifest.spoiled(path) == []
    assert manifest.made_from(path, "part", "abc", name)
    (path / name).write_bytes((path / name).read_bytes()[:-1])
    assert manifest.spoiled(path) == [name]
    (path / name).unlink()
    assert manifest.spoiled(path) == [name]
    manifest.seal(path)
    assert not manifest.made_from(path, "part", "abc", name)


def test_every_flipped_bit_of_a_manifest_is_noticed(tmp_path: Path) -> None:
    path = folder(tmp_path / "r") / "manifest.json"
    whole = path.read_bytes()
    before = manifest.read(tmp_path / "r")
    for place in range(len(whole)):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :])
        try:
            after = manifest.read(tmp_path / "r")
        except UsageError:
            assert manifest.spoiled(tmp_path / "r") == ["manifest.json"]
        else:  # a bit of white space, or of the name under which the hash stands
            assert {key: after[key] for key in before} == before


def test_meanwhile_a_file_is_read_once_whoever_opens_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    plain = files.read_csv
    monkeypatch.setattr(files, "read_csv", lambda path: read.append(path.name) or plain(path))
    place = folder(tmp_path / "r")
    with read_once(place):
        first, second = Results.open(place), Results.open(place)
        assert second.summary is first.summary
        assert second.values("literal", "5", "kf", "rmse") is first.values("literal", "5", "kf", "rmse")
        assert sorted(read) == ["runs.csv", "summary.csv", "table.csv"]
        read.clear()
        files.write(place / "summary.csv", (place / "summary.csv").read_text().replace("0.2", "0.4"))
        manifest.seal(place)
        assert [row["mean"] for row in Results.open(place).summary] == [0.4]
    assert read == ["summary.csv"]
    assert Results.open(place).summary is not first.summary
