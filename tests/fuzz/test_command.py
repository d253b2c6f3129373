"""The real command on hostile files, and what a study does with the extreme numbers that a valid file may hold."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rkfbench.errors import UsageError
from rkfbench.scenario import load
from rkfbench.study.engines import serial
from rkfbench.study.events import Failure
from rkfbench.study.run import run_study
from tests.fuzz import hostile
from tests.fuzz.limits import bounded, percent

ROOT = Path(__file__).parents[2]


def rkfbench(*args: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [sys.executable, "-m", "rkfbench", *args], cwd=ROOT, capture_output=True, check=False, timeout=120
    )


@percent(1)
@given(st.one_of(hostile.mutated(hostile.LARGE), hostile.spliced(hostile.BASES)), hostile.TEXTS)
def test_the_command_ends_with_0_or_2_and_no_traceback(
    tmp_path_factory: pytest.TempPathFactory, text: str, option: str
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "a.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    value = os.fsdecode(option.replace("\0", "").encode("utf-8", "surrogatepass"))[:1000]
    done = rkfbench("validate", str(path), "--set", f"notes={value}")
    assert done.returncode in (0, 2), done
    assert bool(done.stdout) == (done.returncode == 0), done
    assert b"Traceback" not in done.stderr
    assert b"not expected" not in done.stderr


EXTREME = st.sampled_from([0, -0.0, 1e-300, 1e-8, 1, 3, 1e8, 1e60, 1e150, 1e155, 1e300])


@st.composite
def extreme(draw: st.DrawFn) -> str:
    """A small valid scenario with other numbers."""
    numbers = {
        "cov: 1}": f"cov: {draw(EXTREME)}}}",
        "cov: 1, m": f"cov: {draw(EXTREME)}, m",
        "times: 100": f"times: {draw(EXTREME)}",
        "dt: 0.5": f"dt: {draw(EXTREME)}",
        "[1, 1, 1, 1]": str([draw(EXTREME) for _ in range(4)]),
        "[kf, ": f"[kf, {draw(st.sampled_from(FILTERS))}, ",
        "threshold: 2": f"threshold: {draw(EXTREME)}",
    }
    text = hostile.SMALL
    for old, new in numbers.items():
        if draw(st.booleans()):
            text = text.replace(old, new)
    return text


FILTERS = ["aladkf", "ukf", "ckf", "pekf", "{use: mckf, sigma: 1}", "hkf_regression", "hukf"]


@percent(3)
@given(extreme())
def test_a_valid_study_with_extreme_numbers_ends_with_results_or_named_failures(
    tmp_path_factory: pytest.TempPathFactory, text: str
) -> None:
    place = tmp_path_factory.mktemp("fuzz")
    (place / "a.yaml").write_text(text)
    try:
        scenario = load(place / "a.yaml", runs=2, sets=["steps=4"])
    except UsageError:
        return
    told: list[object] = []
    with bounded(), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy about overflow
        outcome = run_study(scenario, place / "r", engine=serial, report=told.append)
    assert [each for each in told if isinstance(each, Failure)] == list(outcome.failures)
    assert all(failure.message for failure in outcome.failures)
    assert (place / "r/summary.csv").exists()


HOSTILE = [
    "x: !!python/object/apply:os.system ['touch {mark}']\n",
    "x: !!python/object/apply:subprocess.check_call [[touch, '{mark}']]\n",
    "x: !!python/name:os.system\n",
    "!!python/module:os : 1\n",
    "x: !include {secret}\n",
    "<<: !include {secret}\n",
    "x: &a !!python/object/new:os.system [touch {mark}]\n",
    "notes: '{secret}'\n",
    "notes: '$(touch {mark})'\n",
    "title: '{{{{ self.__init__.__globals__ }}}}'\n",
    "model: {{kind: 'os.system', dt: '{secret}'}}\n",
    "model: {{kind: '__class__'}}\n",
    'metrics: [\'__import__("os").system("touch {mark}")\']\n',
    'claims: [{{id: a, evidence: ours, claim: \'__import__("os").system("touch {mark}") > 0\'}}]\n',
    "figures: [{{id: '../../{mark}', kind: curve, metric: err_norm@k}}]\n",
    "tables: [{{id: '{mark}', metric: err_norm}}]\n",
    "name: '../{mark}'\n",
    "cases: {{'../../{mark}': {{}}}}\n",
]

# Runs in a process of its own, because an audit hook cannot be taken away: what is opened while hostile files are read.
WATCH = """
import sys
from rkfbench.errors import UsageError
from rkfbench.scenario import load
good, *files = sys.argv[1:]
def tried(file):
    try:
        load(file)
        print("valid", file)
    except UsageError:
        pass
for file in (good, *files):  # imports what they need
    load(file) if file == good else tried(file)
watched = []
def hook(event, args):
    if event in ("open", "exec", "os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "socket.connect"):
        watched.append((event, str(args[0])))
sys.addaudithook(hook)
for file in files:
    watched.clear()
    tried(file)
    for event, what in watched:
        if not what.endswith("dist-info/entry_points.txt"):  # where plug-ins of installed packages are looked for
            print(event, what)
"""


def test_no_file_runs_code_or_reads_another_file_that_it_does_not_name(tmp_path: Path) -> None:
    mark, secret = tmp_path / "mark", tmp_path / "secret"
    secret.write_text("steps: 3\n")
    good = tmp_path / "good.yaml"
    good.write_text(hostile.SMALL)
    names = []
    for index, text in enumerate(HOSTILE):
        path = tmp_path / f"{index}.yaml"
        new = text.format(mark=mark, secret=secret)
        key = new.partition(":")[0]
        kept = [line for line in hostile.SMALL.splitlines(keepends=True) if not line.startswith(f"{key}:")]
        path.write_text("".join(kept) + new)
        names.append(str(path))
    done = subprocess.run(
        [sys.executable, "-c", WATCH, str(good), *names], cwd=ROOT, capture_output=True, text=True, check=True
    )
    events = [line.split(" ", 1) for line in done.stdout.splitlines()]
    assert [what for event, what in events if event == "open"] == names
    assert {event for event, _ in events} <= {"open", "valid"}
    assert not mark.exists()


@pytest.mark.slow
def test_figures_tables_and_cases_cannot_leave_their_folder(tmp_path: Path) -> None:
    """What a scenario calls things becomes file names."""
    for index, text in enumerate(
        [
            "figures: [{id: ../../up, kind: curve, metric: err_norm@k}]\n",
            "tables: [{id: ../../up, metric: err_norm}]\n",
            f"tables: [{{id: {tmp_path}/up, metric: err_norm}}]\n",
            "cases: {../../up: {}}\n",
            "readings: {../../up: {}}\nfigures: [{id: a, kind: curve, metric: err_norm@k}]\n",
        ]
    ):
        (tmp_path / "a.yaml").write_text(hostile.SMALL + text)
        before = {*tmp_path.iterdir(), tmp_path / "deep"}
        out = tmp_path / "deep" / str(index)
        done = rkfbench("run", str(tmp_path / "a.yaml"), "--runs", "2", "--out", str(out))
        assert done.returncode in (0, 2), done
        assert b"Traceback" not in done.stderr
        assert before >= set(tmp_path.iterdir())
        assert {path.name for path in (tmp_path / "deep").glob("*")} <= {str(each) for each in range(index + 1)}


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
def test_a_file_without_end_is_refused() -> None:
    with bounded(), pytest.raises(UsageError, match="larger than 10 MB"):
        load("/dev/zero")
