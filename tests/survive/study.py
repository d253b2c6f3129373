"""A study to be killed, starved and damaged, as small as one with blocks, a claim, tables and a figure can be.

It runs as a user runs it, as a process of the real command, and is compared with one that nothing disturbed.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.testing import CliRunner

from rkfbench.cli.commands import app
from rkfbench.store import blocks, place

ROOT = Path(__file__).parents[2]
COMMAND = (sys.executable, "-m", "rkfbench")  # in ROOT: its own rkfbench, whatever is installed

SCENARIO = """\
name: survivor
seed: 5
runs: {paper: RUNS}
steps: 12
model: {kind: navigation, dt: 0.5, observed: [px, py, vx]}
start: {truth: [1, 1, 1, 1]}
process_noise: {kind: gaussian, cov: 1}
measurement_noise:
  kind: contaminated
  rate: 0.05
  body: {kind: gaussian, cov: 1}
  outliers: {kind: laplace, cov: {times: 100, of: body}}
assumed: {mean: [0, 0, 0, 0], cov: 1, measurement_cov: body}
sweep: {measurement_noise.rate: [0, 0.4]}
filters: [kf, {use: hkf, threshold: 2}]
metrics: [err_norm, pooled_rmse, err_norm@k]
figures:
  - {id: errors, kind: curve, metric: err_norm@k}
tables:
  - {id: errors, metric: err_norm}
  - {id: times, metric: time_ms}
claims:
  - id: outliers
    says: outliers make the error of the KF larger
    evidence: ours
    ordering: {metric: err_norm, filters: kf, cases: [rate=0.4, rate=0], along: cases}
"""
RUNS, BLOCKS = 9000, 6  # three blocks of each of two cases
SMALL = 20  # runs, where it is about the number of files and not of blocks


@dataclass(frozen=True)
class Study:
    """The study in one folder, and ways to run it there."""

    place: Path  # holds the scenario and the results

    @classmethod
    def at(cls, place: Path, runs: int = RUNS) -> Study:
        place.mkdir(parents=True, exist_ok=True)
        (place / "survivor.yaml").write_text(SCENARIO.replace("RUNS", str(runs)))
        return cls(place)

    @property
    def results(self) -> Path:
        return self.place / "results/survivor"

    def start(self, *options: str, under: tuple[str, ...] = (), **how: Any) -> subprocess.Popen[str]:
        """The command in a session of its own, so that a signal can reach all its processes and no other; it may be
        started `under` another command.
        """
        return subprocess.Popen(
            [*under, *COMMAND, "run", str(self.place / "survivor.yaml"), "--out", str(self.results), *options],
            cwd=ROOT,  # whose rkfbench it is
            env=os.environ | how.pop("env", {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            **how,
        )

    def run(self, *options: str, **how: Any) -> Ended:
        return ended(self.start(*options, **how))

    def run_here(self) -> Ended:
        """The same in this process."""
        done = CliRunner().invoke(app, ["run", str(self.place / "survivor.yaml"), "--out", str(self.results)])
        return Ended(done.exit_code, done.stdout, done.stderr)

    def command(self, *args: str) -> Ended:
        """Another command."""
        done = subprocess.run([*COMMAND, *args], cwd=ROOT, capture_output=True, text=True, check=False)
        return Ended(done.returncode, done.stdout, done.stderr)

    def numbers(self) -> dict[str, bytes]:
        """Every file that depends on nothing but the scenario; what a clock measured is left out."""
        return {name: content for name, content in self.files().items() if not _timed(name)}

    def files(self) -> dict[str, bytes]:
        """Every file that a reader of the folder sees, but for the manifest, which has times."""
        found = {path.relative_to(self.results).as_posix(): path for path in sorted(self.results.rglob("*"))}
        return {
            name: path.read_bytes()
            for name, path in found.items()
            if path.is_file() and not path.name.startswith(".") and name != "manifest.json"
        }

    def blocks(self) -> int:
        return len(list((self.results / "blocks").glob("*.block")))

    def unsealed(self) -> bool:
        return not (self.results / "manifest.json").exists()

    def hidden(self) -> list[str]:
        """Temporary files and locks."""
        return [path.name for path in self.results.rglob(".*") if path.name != place.OWNER]

    def listed(self) -> dict[str, str]:
        """The hashes in the manifest."""
        return json.loads((self.results / "manifest.json").read_text())["files"]


@dataclass(frozen=True)
class Ended:
    """A command that has ended: exit code (negative: killed by that signal) and both streams."""

    code: int
    out: str
    err: str


def ended(process: subprocess.Popen[str]) -> Ended:
    out, err = process.communicate(timeout=300)
    return Ended(process.returncode, out, err)


def is_whole(study: Study, whole: dict[str, bytes]) -> None:
    """Whatever ended the study, no file that a reader sees is other than that of the undisturbed study; a block may
    hold some of the filters only, which are whole.
    """
    for name, content in study.numbers().items():
        same = content == whole[name] or (name.startswith("blocks/") and content == _cut(whole[name], study, name))
        assert same, f"{name} is half written"


def _cut(block: bytes, study: Study, name: str) -> bytes:
    """What a block would be with those filters alone that its file has."""
    path = study.place / "cut.block"
    path.write_bytes(block)
    parts, keys = blocks.read(path), blocks.keys(path)
    blocks.write(path, {label: (keys[label], parts[label]) for label in sorted(blocks.keys(study.results / name))})
    return path.read_bytes()


def goes_on(study: Study, whole: dict[str, bytes], *options: str) -> Ended:
    """The same command once more completes the study: the same bytes, nothing left over, used blocks told."""
    before = sum(name.startswith("blocks/") and content == whole[name] for name, content in study.numbers().items())
    done = study.run(*options)
    assert (done.code, done.out) == (0, f"{study.results}\n"), done.err
    assert "Traceback" not in done.err
    if 0 < before < BLOCKS:
        assert re.search(rf"{BLOCKS - before} blocks computed, {before} used again", done.err), done.err
    if before == BLOCKS:
        assert "nothing to compute" in done.err
    assert study.numbers() == whole
    assert study.hidden() == []
    return done


def _timed(name: str) -> bool:
    return name.startswith(("timings/", "tables/times."))
