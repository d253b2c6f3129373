"""A small scenario, and a way to change and load it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from rkfbench.errors import ScenarioError
from rkfbench.scenario import Scenario, load

SMALL = """\
name: small
seed: 1
runs: {paper: 4, reference: 8}
steps: 5
model: {kind: navigation, observed: [px, py]}
start: {truth: [0, 0, 1, 1]}
process_noise: {kind: gaussian, cov: 0.1}
measurement_noise:
  kind: contaminated
  rate: 0.1
  body: {kind: gaussian, cov: 1}
  outliers: {kind: laplace, cov: 100}
assumed: {mean: [0, 0, 0, 0], cov: 10, measurement_cov: body}
readings:
  plain: {}
  coins: {measurement_noise.coin: component}
sensitivity:
  wide start: {assumed.cov: 100}
cases:
  near: {}
  far: {start.truth: [100, 100, 1, 1]}
sweep: {measurement_noise.rate: [0, 0.2]}
filters:
  - kf
  - {use: hkf, threshold: 2}
  - {use: hkf, threshold: [0.5, 3], extra: true}
metrics: [rmse, "rmse[px]", err_norm@k]
figures:
  - {id: rates, kind: sweep, over: rate, metric: rmse, filters: [kf, hkf]}
"""

Load = Callable[..., Scenario]


@pytest.fixture
def change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Load:
    """Load the small scenario after replacing texts in it: change({old: new}, sets=[...])."""
    monkeypatch.chdir(tmp_path)

    def changed(texts: dict[str, str] | None = None, **options: object) -> Scenario:
        text = SMALL
        for old, new in (texts or {}).items():
            assert old in text
            text = text.replace(old, new, 1)
        (tmp_path / "a.yaml").write_text(text, encoding="utf-8")
        return load("a.yaml", **options)  # type: ignore[arg-type]

    return changed


@pytest.fixture
def problems(change: Load) -> Callable[..., list[str]]:
    """The problems of the changed scenario, without the source lines."""

    def found(texts: dict[str, str] | None = None, **options: object) -> list[str]:
        with pytest.raises(ScenarioError) as error:
            change(texts, **options)
        lines = str(error.value).splitlines()
        return [line for line in lines if not line.startswith("  ")]

    return found
