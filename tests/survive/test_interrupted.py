"""Ctrl-C, at any moment: exit code 130 and one line, nothing half written, the same command goes on from there."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from tests.survive.conftest import Whole
from tests.survive.study import ROOT, Study, ended, goes_on, is_whole

INTERRUPTS = 20
LAST_LINE = "the same command goes on from there"


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("interrupt", range(INTERRUPTS))
def test_a_run_answers_to_ctrl_c_at_any_moment(study: Study, undisturbed: Whole, jobs: str, interrupt: int) -> None:
    """As a terminal does it: every process of the group gets the signal."""
    span = undisturbed.seconds * (1.0 if jobs == "1" else 1.5)
    moment = span * (interrupt + random.random()) / INTERRUPTS
    process = study.start("--jobs", jobs)
    begin = time.monotonic()
    while not is_rkfbench(process.pid) or time.monotonic() - begin < moment:  # Python's own start is not ours to mend
        time.sleep(0.001)
        if process.poll() is not None:
            break
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)
    done = ended(process)
    print(f"interrupted after {moment:.3f} s with {study.blocks()} blocks: {done}")
    too_late = interrupt > INTERRUPTS // 2 and study.numbers() == undisturbed.numbers
    assert done.code == 130 or (done.code == 0 and too_late)
    assert "Traceback" not in done.err
    is_whole(study, undisturbed.numbers)
    goes_on(study, undisturbed.numbers, "--jobs", jobs)


@pytest.mark.slow
def test_a_second_ctrl_c_changes_nothing(study: Study, whole: dict[str, bytes]) -> None:
    process = study.start("--jobs", "2")
    while not study.blocks():
        time.sleep(0.002)
    for _ in range(5):
        os.killpg(process.pid, signal.SIGINT)
        time.sleep(0.02)
    done = ended(process)
    assert (done.code, "Traceback" in done.err) == (130, False), done.err
    goes_on(study, whole)


def test_ctrl_c_while_the_command_is_still_being_imported() -> None:
    code = """
import sys, rkfbench.cli, rkfbench.cli.commands
def app(prog_name):
    print("said")
    raise KeyboardInterrupt
rkfbench.cli.commands.app = app
rkfbench.cli.main()
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "said\n", "")


def test_ctrl_c_in_a_destructor_is_not_lost() -> None:
    """Python can only report what a destructor raises: of a run, the message was all that came of the Ctrl-C."""
    code = """
import os, signal, sys, time, rkfbench.cli, rkfbench.cli.commands
class Closing:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass
def app(prog_name):
    Closing()
    time.sleep(30)
    print("went on")
rkfbench.cli.commands.app = app
rkfbench.cli.main()
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=25)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


class Interrupting:
    """An `os.replace` with a Ctrl-C at its `n`-th call, before it does its work or after."""

    def __init__(self, n: int, before: bool) -> None:
        self.n, self.before, self.calls = n, before, 0
        self.replace = os.replace

    def __call__(self, source: Any, target: Any) -> None:
        self.calls += 1
        if self.calls == self.n and self.before:
            raise KeyboardInterrupt
        self.replace(source, target)
        if self.calls == self.n:
            raise KeyboardInterrupt


@pytest.mark.parametrize("share", [0.9, *(pytest.param(i / 40, marks=pytest.mark.slow) for i in range(40))])
@pytest.mark.parametrize("before", [pytest.param(True, marks=pytest.mark.slow), False])
def test_ctrl_c_at_any_file_leaves_whole_files(
    small: Study, small_whole: dict[str, bytes], writes: int, share: float, before: bool
) -> None:
    """Blocks, tables, claims, drawings, manifests: just before a file takes its place, or just after."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "replace", Interrupting(1 + int(share * writes), before))
        interrupted = small.run_here()
    assert interrupted.code == 130
    assert interrupted.err.endswith(f"{LAST_LINE}\n")
    is_whole(small, small_whole)
    assert small.hidden() == []
    assert small.run_here().code == 0
    assert small.numbers() == small_whole


def is_rkfbench(pid: int) -> bool:
    """Whether the process has come as far as the command: then `typer` is loaded (Linux)."""
    try:
        return "pydantic_core" in Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return True
