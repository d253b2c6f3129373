"""What the README shows does run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rkfbench.scenario import load
from rkfbench.study.compute import compute

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", README, re.DOTALL)
    assert found
    return found.group(1)


def test_the_scenario_runs(tmp_path):
    path = tmp_path / "my-outliers.yaml"
    path.write_text(block("yaml"), encoding="utf-8")
    scenario = load(path)
    spec = scenario.cells[1].spec
    labels = [each["label"] for each in spec["filters"]]
    result = compute(spec, scenario.seed, 0, 50, labels)
    assert set(result.filters) == {"clairvoyant_kf", "kf", "aladkf", "hkf[threshold=1]", "hkf[threshold=2]"}


def test_the_python_example_runs():
    rng = np.random.default_rng(1)
    known = {"y": rng.standard_normal((20, 3)), "x0": np.zeros(4), "P0": np.eye(4), "Q": np.eye(4), "R": np.eye(3)}
    exec(block("python"), known)
    assert known["estimate"].mean.shape == (20, 4, 1)


def test_the_figure_and_every_bundled_scenario_are_there():
    from rkfbench.scenario import bundled

    root = Path(__file__).parents[1]
    assert all((root / path).exists() for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README))
    assert [name for name in bundled() if f"`{name}`" not in README] == []
