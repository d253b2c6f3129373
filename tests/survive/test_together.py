"""Two runs in one folder, what a dead run leaves there, and clocks that jump."""

from __future__ import annotations

import os
import time

import pytest

from tests.survive.study import Study, ended, goes_on


@pytest.mark.slow
@pytest.mark.parametrize("second", ["run", "report"])
def test_a_folder_that_is_in_use_is_refused(study: Study, whole: dict[str, bytes], second: str) -> None:
    study.run("--jobs", "1")
    first = study.start("--fresh")
    while not (study.results / ".lock").exists():
        time.sleep(0.001)
    other = study.run() if second == "run" else study.command("report", str(study.results))
    assert f"in use by another run (process {first.pid})" in other.err
    assert (other.code, other.out, "Traceback" in other.err) == (2, "", False)
    assert ended(first).code == 0
    assert study.numbers() == whole


@pytest.mark.slow
def test_twenty_runs_at_once_make_one_folder(study: Study, whole: dict[str, bytes]) -> None:
    """All begin together; those that come in while another one is at work are refused, and nothing else happens."""
    every = [ended(process) for process in [study.start("--jobs", "1") for _ in range(20)]]
    assert {each.code for each in every} <= {0, 2}
    assert any(each.code == 0 for each in every)
    assert [each.err for each in every if each.code == 2 and "in use by another run" not in each.err] == []
    assert study.numbers() == whole
    assert study.hidden() == []


@pytest.mark.slow
def test_the_lock_of_a_dead_run_holds_nobody_up(study: Study, whole: dict[str, bytes]) -> None:
    study.results.mkdir(parents=True)
    (study.results / ".lock").write_text("1")  # a process that lives, but not ours
    (study.results / ".runs.csv.1.tmp").write_text("half a")
    goes_on(study, whole)


@pytest.mark.slow
@pytest.mark.parametrize("jump", [-10 * 365 * 86400, 86400 * 365 * 10])
def test_a_clock_that_jumps_changes_nothing(study: Study, whole: dict[str, bytes], jump: float) -> None:
    """The time of day decides nothing: not while a run goes on, and not whether its files are used again."""
    (study.place / "sitecustomize.py").write_text(
        "import itertools, os, time\n"
        "now, calls = time.time, itertools.count()\n"
        f"time.time = lambda: now() + ({jump} if next(calls) % 2 else 0)\n"
        f"open({str(study.place / 'jumped')!r}, 'a').close()\n"
    )
    env = {"PYTHONPATH": str(study.place), "TZ": "Pacific/Kiritimati"}
    assert study.run("--jobs", "2", env=env).code == 0
    assert (study.place / "jumped").exists()
    assert study.numbers() == whole
    for path in study.results.rglob("*"):
        os.utime(path, (time.time() + jump, time.time() + jump))
    before = {path: path.stat().st_mtime_ns for path in (study.results / "blocks").iterdir()}
    again = study.run(env={"TZ": "America/Los_Angeles"})
    assert "nothing to compute" in again.err
    assert study.numbers() == whole
    assert {path: path.stat().st_mtime_ns for path in (study.results / "blocks").iterdir()} == before
