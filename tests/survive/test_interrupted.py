"""Ctrl-C, at any moment: exit code 130 and one line, nothing half written, the same command goes on from there."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import pytest

from tests.survive.conftest import Whole
from tests.survive.study import ROOT, Ended, Study, ended, goes_on, is_whole

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
    too_late = interrupt >= INTERRUPTS // 4 and study.numbers() == undisturbed.numbers
    assert done.code == 130 or (done.code == 0 and too_late)
    assert "Traceback" not in done.err and "Warning" not in done.err
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


def commanded(body: str) -> Ended:
    """The command with something else in the place of its app: `interrupt()` is a Ctrl-C."""
    code = f"""
import contextlib, os, signal, sys, time, rkfbench.cli, rkfbench.cli.commands
def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    for _ in range(1000):
        pass
{textwrap.dedent(body)}
rkfbench.cli.commands.app = app
rkfbench.cli.main()
"""
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=25)
    return Ended(done.returncode, done.stdout, done.stderr)


def test_ctrl_c_while_the_command_is_still_being_imported() -> None:
    done = commanded("""
        def app(prog_name):
            print("said")
            raise KeyboardInterrupt
        """)
    assert done == Ended(130, "said\n", "")


def test_ctrl_c_in_a_destructor_is_not_lost() -> None:
    """Python can only report what a destructor raises: of a run, the message was all that came of the Ctrl-C."""
    done = commanded("""
        class Closing:
            def __del__(self):
                interrupt()
        def app(prog_name):
            Closing()
            time.sleep(30)
            print("went on")
        """)
    assert done == Ended(130, "", "")


def test_ctrl_c_that_something_swallows_comes_again() -> None:
    done = commanded("""
        def app(prog_name):
            with contextlib.suppress(BaseException):
                interrupt()
            print("swallowed")
            time.sleep(30)
            print("went on")
        """)
    assert done == Ended(130, "swallowed\n", "")


def test_ctrl_c_that_becomes_another_error_is_still_one() -> None:
    done = commanded("""
        from rkfbench.cli.commands import command, typer
        app = typer.Typer()
        @app.command()
        @command
        def swallowing(terminal):
            try:
                interrupt()
            except KeyboardInterrupt:
                raise ValueError("wrong type") from None
        """)
    assert done == Ended(130, "", f"interrupted: {LAST_LINE}\n")


def test_what_answers_a_ctrl_c_is_not_interrupted() -> None:
    """By the one that comes again, or by an impatient user, also where an error of its own is handled there."""
    done = commanded("""
        def app(prog_name):
            try:
                interrupt()
            finally:
                try:
                    raise FileNotFoundError
                except FileNotFoundError:
                    time.sleep(0.2)
                interrupt()
                print("cleaned")
        """)
    assert done == Ended(130, "cleaned\n", "")


def test_ctrl_c_ignored_from_outside_stays_ignored() -> None:
    done = commanded("""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        def app(prog_name):
            interrupt()
            time.sleep(0.2)
            print("went on")
        """)
    assert done == Ended(0, "went on\n", "")


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
