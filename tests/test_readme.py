"""What the README shows does run."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

from rkfbench.cli.commands import app
from rkfbench.scenario import load
from rkfbench.store import Results
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


def commands(scenario):
    """The commands that the README shows for a scenario."""
    shown = re.findall(rf"(?m)^ *rkfbench (\w+ {scenario}\S*.*)$", README)
    return [line.partition("#")[0] for line in shown]


def test_the_commands_run_on_the_scenario(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my-outliers.yaml").write_text(block("yaml").replace("steps: 200", "steps: 5"), encoding="utf-8")
    shown = [line for line in commands("my-outliers.yaml") if "tcp://" not in line and "ARRAY" not in line]
    assert len(shown) == 3
    for line in shown:
        small = "--max-runs 200" if "--precision" in line else "--runs 200 --jobs 1"  # what stands last counts
        result = CliRunner().invoke(app, [*line.split(), *small.split()])
        assert result.exit_code == 0, result.output


def test_the_python_example_runs():
    rng = np.random.default_rng(1)
    known = {"y": rng.standard_normal((20, 3)), "x0": np.zeros(4), "P0": np.eye(4), "Q": np.eye(4), "R": np.eye(3)}
    exec(block("python"), known)
    assert known["estimate"].mean.shape == (20, 4, 1)


def test_the_own_filter_runs_beside_ours(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    source = next(each for each in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if "# my_filter.py" in each)
    assert len(source.splitlines()) <= 21
    Path("my_filter.py").write_text(source, encoding="utf-8")
    filters = next(
        line.strip().partition("  ")[0] for line in README.splitlines() if "my_filter.py:clipped, th" in line
    )
    scenario = re.sub("(?m)^(filters|figures|tables|claims):.*$", "", block("yaml").partition("claims:")[0]) + filters
    Path("my-outliers.yaml").write_text(scenario, encoding="utf-8")
    result = CliRunner().invoke(app, ["run", "my-outliers.yaml", "--runs", "4"])
    assert result.exit_code == 0, result.output
    summary = Results.open(result.stdout.strip()).summary
    assert {row["filter"] for row in summary} == {"kf", "hkf", "clipped[threshold=2]", "clipped[threshold=3]"}
    assert CliRunner().invoke(app, ["check", "my_filter.py:clipped"]).exit_code == 0


def test_the_figure_and_every_bundled_scenario_are_there():
    from rkfbench.scenario import bundled

    root = Path(__file__).parents[1]
    assert all((root / path).exists() for path in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", README))
    assert [name for name in bundled() if f"`{name}`" not in README] == []
