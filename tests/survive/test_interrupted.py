"""Ctrl-C, at any moment: exit code 130 and one line, nothing half written, the same command goes on from there."""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from rkfbench.cli import main
from tests.survive.conftest import Whole
from tests.survive.study import SMALL, Study, ended, goes_on, is_whole

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
    assert done.code == 130 or (done.code == 0 and study.numbers() == undisturbed.numbers)
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


def test_ctrl_c_while_the_command_is_still_being_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(prog_name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys, "argv", ["rkfbench", "--version"])
    monkeypatch.setattr("rkfbench.cli.commands.app", interrupted)
    before = signal.getsignal(signal.SIGINT)
    try:
        with pytest.raises(SystemExit, match="130"):
            main()
    finally:
        signal.signal(signal.SIGINT, before)


class Interrupting:
    """An `os.replace` with a Ctrl-C at its `n`-th call, before it does its work or after; 0 only counts."""

    def __init__(self, n: int, before: bool = True) -> None:
        self.n, self.before, self.calls = n, before, 0
        self.replace = os.replace

    def __call__(self, source: Any, target: Any) -> None:
        self.calls += 1
        if self.calls == self.n and self.before:
            raise KeyboardInterrupt
        self.replace(source, target)
        if self.calls == self.n:
            raise KeyboardInterrupt


@pytest.fixture(scope="module")
def writes(tmp_path_factory: pytest.TempPathFactory) -> int:
    """The files that the small study writes, the manifest each time."""
    with pytest.MonkeyPatch.context() as patch:
        count = Interrupting(0)
        patch.setattr(os, "replace", count)
        assert Study.at(tmp_path_factory.mktemp("count"), runs=SMALL).run_here().code == 0
        return count.calls


@pytest.mark.parametrize("share", [0.4, 0.97, *(pytest.param(i / 40, marks=pytest.mark.slow) for i in range(40))])
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
