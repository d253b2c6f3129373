"""What tests of several parts share: a scenario small enough to run in a moment."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def _ctrl_c_as_it_was() -> Iterator[None]:
    """The command ends with Ctrl-C ignored, and tests call it in their own process; or they run in the background of a
    shell, where it is ignored from the beginning.
    """
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


SMALL = """\
name: small
title: A small study
seed: 5
runs: {paper: 6, reference: 8}
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
"""

CLAIMS = """\
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


@pytest.fixture
def small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a small scenario, in a current directory of its own."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


@pytest.fixture
def claiming(small: Path) -> Path:
    """The same scenario with a claim, a table and a figure."""
    small.write_text(SMALL + CLAIMS)
    return small
