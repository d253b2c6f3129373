"""SIGKILL, at any moment: what is on the disk is whole, no process stays behind, the same command goes on."""

from __future__ import annotations

import os
import random
import re
import signal
import time
from pathlib import Path

import pytest

from tests.survive.conftest import Whole
from tests.survive.study import Study, ended, goes_on, is_whole

KILLS = 20


@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.slow)])
@pytest.mark.parametrize("kill", [7, *(pytest.param(i, marks=pytest.mark.slow) for i in range(KILLS) if i != 7)])
def test_a_killed_run_goes_on_to_the_same_bytes(study: Study, undisturbed: Whole, jobs: str, kill: int) -> None:
    span = undisturbed.seconds * (1.0 if jobs == "1" else 1.5)
    moment = span * (0.15 + 0.85 * (kill + random.random()) / KILLS)  # before that, Python itself starts
    process = study.start("--jobs", jobs)
    time.sleep(moment)
    process.kill()
    ended(process)
    print(f"killed after {moment:.3f} s with {study.blocks()} blocks")
    is_whole(study, undisturbed.numbers)
    assert no_process_is_left(process.pid)
    goes_on(study, undisturbed.numbers, "--jobs", jobs)


@pytest.mark.slow
def test_a_run_is_killed_again_and_again(study: Study, undisturbed: Whole) -> None:
    """Each attempt gets as far as one more block."""
    for attempt in range(1, 4):
        process = study.start("--jobs", "1")
        wait_for_blocks(study, attempt)
        process.kill()
        ended(process)
        is_whole(study, undisturbed.numbers)
    goes_on(study, undisturbed.numbers)


def test_no_worker_outlives_its_driver(study: Study, whole: dict[str, bytes]) -> None:
    process = study.start("--jobs", "2")
    wait_for_blocks(study, 1)
    process.kill()
    process.wait()
    assert no_process_is_left(process.pid)
    ended(process)
    goes_on(study, whole, "--jobs", "2")


@pytest.mark.slow
def test_a_killed_worker_is_told_and_its_run_goes_on(study: Study, whole: dict[str, bytes]) -> None:
    long = ("--jobs", "2", "--set", "steps=120")
    process = study.start(*long)
    wait_for_blocks(study, 1)
    os.kill(workers(process.pid)[0], signal.SIGKILL)
    done = ended(process)
    kept = study.blocks()
    assert (done.code, done.out) == (1, "")
    assert done.err.splitlines()[-1].startswith(
        "a worker process was killed (out of memory?); finished blocks are kept"
    )
    assert "Traceback" not in done.err
    assert kept >= 1
    assert study.unsealed()
    assert no_process_is_left(process.pid)
    again = study.run(*long)
    assert again.code == 0
    assert re.search(r"[1-9]\d* used again", again.err)  # a block on its way may be kept in part
    other = Study.at(study.place / "other")
    other.run("--jobs", "1", "--set", "steps=120")
    assert study.numbers() == other.numbers()


def wait_for_blocks(study: Study, count: int) -> None:
    deadline = time.monotonic() + 60
    while study.blocks() < count:
        assert time.monotonic() < deadline, "no block was written"
        time.sleep(0.002)


def workers(driver: int) -> list[int]:
    """The worker processes of a driver (Linux): its children that compute."""
    found = []
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(status.read_text().rpartition(")")[2].split()[1])
            command = (status.parent / "cmdline").read_text()
        except OSError:  # it has just ended
            continue
        if parent == driver and "spawn_main" in command:
            found.append(int(status.parent.name))
    return sorted(found)


def no_process_is_left(session: int) -> bool:
    """Whether every process of the group ends within some seconds."""
    deadline = time.monotonic() + 10
    while time.monotonic() < deadline:
        try:
            os.killpg(session, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    os.killpg(session, signal.SIGKILL)
    return False
