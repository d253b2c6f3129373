"""Own models, noise laws, robust weights and metrics, by themselves and in an experiment."""

import re
import textwrap
from pathlib import Path

import numpy as np
import pytest

from rkfbench import metrics, models, noise
from rkfbench.errors import SpecError
from rkfbench.filters import build
from rkfbench.own import parts
from rkfbench.own.faults import PluginFault
from rkfbench.store import Results
from rkfbench.streams import Onward, Streams
from rkfbench.study.compute import compute
from tests.contract import SPECS
from tests.problems import linear_problem
from tests.test_cli import rkfbench

SPEC = {**SPECS["navigation"], "filters": [{"label": "kf", "use": "kf"}]}


def test_a_model_is_used_like_any_other(folder):
    model = models.build({"kind": "plugins:Walk", "step": 0.9})
    y = np.ones((5, 1, 3))
    told = {"x0": np.ones(2), "P0": np.eye(2), "Q": np.eye(2), "R": np.eye(1)}
    for name in ("ekf", "ukf", "plugins:stepwise"):
        assert np.isfinite(build(name).run(model, y, **told).mean).all()
    with pytest.raises(SpecError, match="greater than 0"):
        models.build({"kind": "plugins:Walk", "step": 0})


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("plugins:Flat", r"h of plugins:Flat has shape \(3,\), expected \(1, 3\)"),
        ("plugins:Bare", "without `measurements`"),
        ("plugins:Turn", "f of plugins:Turn is not F x . b, as its class says: give the class `affine = False`"),
        ("plugins:student", "dim: is required"),
        ("plugins.py:nothing", "no 'nothing'"),
    ],
)
def test_what_makes_no_model_is_told(folder, kind, message):
    with pytest.raises(SpecError, match=message):
        models.build({"kind": kind})


def test_a_law_is_used_like_any_other_also_as_a_body(folder):
    law = noise.build({"kind": "plugins:student", "nu": 6}, 2)
    np.testing.assert_allclose(law.cov, 1.5 * np.eye(2))
    value = law.sample(Streams(1), 50).value
    assert value.shape == (50, 2, 128)
    np.testing.assert_array_equal(law.sample(Streams(1), 20).value, value[:20])
    mixed = {"kind": "contaminated", "rate": 0.1, "body": {"kind": "plugins:student"}}
    mixed["outliers"] = {"kind": "gaussian", "cov": {"times": 100, "of": "body"}}
    assert noise.build(mixed, 2).sample(Streams(1), 5).value.shape == (5, 2, 128)


def test_parts_of_a_law_have_draws_of_their_own(folder):
    value = noise.build({"kind": "plugins:in_parts"}, 2).sample(Streams(1), 50).value
    assert value.std() > 1


def test_a_law_around_another_draws_once_and_goes_on_from_step_to_step(folder):
    law = noise.build({"kind": "plugins:around"}, 2)
    assert law.sample(Streams(1), 50).value.shape == (50, 2, 128)
    onward = Onward(1, 0, 1, "filter/", 5)
    first, second = (law.sample(onward, 1).value for _ in range(2))
    assert not np.any(first == second)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("plugins:wild", "gives other values each time"),
        ("plugins:shaped", r"draw.normal\(\(2, 2\)\): first comes a purpose, .*: draw.normal\('value', steps, dim\)"),
        ("plugins:twice", "draws the purpose 'value' twice, which gives the same random numbers"),
        ("plugins:generating", "has no attribute 'generators'"),
        ("plugins:narrow", r"sample of plugins:narrow has shape \(2, 128\), expected \(2, 2, 128\)"),
        ("plugins:lopsided", "not a covariance"),
        ("plugins:whole", "no parameter `dim`"),
    ],
)
def test_what_makes_no_law_is_told(folder, kind, message):
    with pytest.raises(SpecError, match=message):
        noise.build({"kind": kind}, 2)


def test_what_a_law_does_not_have_is_told_where_it_is_needed(folder):
    law = noise.build({"kind": "plugins:student"}, 2)
    with pytest.raises(PluginFault, match="no `logpdf`"):
        law.logpdf(np.zeros(2))
    with pytest.raises(PluginFault, match=r"plugins:student has no `marginal\(rows\)`, the law of some components"):
        law.marginal(np.array([0]))
    with pytest.raises(PluginFault, match="no Sample with the record"):
        law.sample(Streams(1), 2).cov()


GAPS = """\
name: gaps
data: {measurements: seen.csv}
model: {kind: navigation, dt: 0.5, observed: [px, py]}
measurement_noise: {kind: "plugins.py:KIND"}
assumed: {mean: [0, 0, 8, 3], cov: 1, process_cov: 0.1, measurement_cov: law}
filters: [kf, {use: pf, particles: 50}]
metrics: ["state[px]"]
"""


def test_a_law_with_a_marginal_is_that_of_its_components(folder):
    law = noise.build({"kind": "plugins:dense"}, 3)
    e = np.arange(6.0).reshape(2, 3)
    part = law.marginal(np.array([0, 2]))
    np.testing.assert_array_equal(part.logpdf(e), noise.build({"kind": "plugins:dense"}, 2).logpdf(e))
    assert part.sample(Streams(1), 4).value.shape == (4, 2, 128)


@pytest.mark.parametrize(("kind", "exit_code"), [("dense", 0), ("unfinished", 1)])
def test_a_particle_filter_weighs_what_is_measured_of_a_vector(folder, monkeypatch, kind, exit_code):
    monkeypatch.chdir(folder)
    with Path("plugins.py").open("a") as file:
        file.write("\n\nclass unfinished(student):\n    logpdf = dense.logpdf\n")
    Path("seen.csv").write_text("px,py\n1,2\n1.5,\n2,3\n")
    Path("s.yaml").write_text(GAPS.replace("KIND", kind))
    result = rkfbench("run", "s.yaml")
    assert result.exit_code == exit_code, result.output
    missing = "plugins.py:unfinished has no `marginal(rows)`, the law of some components, which this filter needs"
    assert (missing in result.stderr) == (exit_code == 1), result.stderr


def test_a_weight_combines_with_moments(folder):
    problem = linear_problem()
    spec = {"moments": "linear", "weight": {"plugins:inflate": {"c": 1e9}}}
    mine, kf = (build(each).run(problem.model, problem.y, **problem.told) for each in (spec, "kf"))
    np.testing.assert_allclose(mine.mean, kf.mean, atol=1e-9)
    robust = build({"moments": "unscented", "weight": "plugins:inflate"}).run(problem.model, problem.y, **problem.told)
    assert np.abs(robust.mean - kf.mean).max() > 1
    with pytest.raises(PluginFault, match=r"plugins:thin returned an R of shape \(3, 1\), expected"):
        build({"moments": "linear", "weight": "plugins:thin"}).run(problem.model, problem.y, **problem.told)


def test_metrics_are_reduced_like_any_other(folder):
    names = [
        "plugins:largest",
        "plugins.py:largest(power=2)[px,py]@3",
        "plugins:largest@k",
        "plugins:spread",
        "err_norm",
    ]
    result = compute({**SPEC, "metrics": names}, 1, 0, 128, ["kf"]).filters["kf"]
    curve = result.curves["plugins:largest@k"]
    np.testing.assert_allclose(result.values["plugins:largest"], curve.mean(0))
    assert (result.values["plugins:largest"] <= result.values["err_norm"]).all()
    assert (result.values["plugins.py:largest(power=2)[px,py]@3"] <= curve[2] ** 2 + 1e-12).all()
    assert np.ptp(result.values["plugins:spread"]) == 0


@pytest.mark.parametrize("name", ["plugins:nothing", "plugins:largest(power=a)", "plugins:no_run"])
def test_what_makes_no_metric_is_told(folder, name):
    with pytest.raises(SpecError):
        metrics.get(name)


def test_a_metric_of_the_wrong_shape_is_told(folder):
    with pytest.raises(PluginFault, match=r"plugins:short returned shape \(3,\), expected \(12, 128\)"):
        compute({**SPEC, "metrics": ["plugins:short"]}, 1, 0, 128, ["kf"])


EXAMPLES = """\
name: examples
seed: 1
runs: {paper: 8, reference: 8}
steps: 20
model: {kind: examples:Pendulum, dt: 0.2}
start: {truth: [1, 0]}
measurement_noise: {kind: examples:Uniform, half: 0.5}
assumed: {mean: [0, 0], cov: 1, process_cov: 0.01}
filters: [ekf, ckf]
metrics: [rmse, examples:worst, "examples:worst[rate]"]
"""


def test_the_examples_of_the_docstring_work(folder, monkeypatch):
    monkeypatch.chdir(folder)
    blocks = re.findall(r"(?m)(?:^    .*\n|^\n(?=    ))+", parts.__doc__)
    head = (
        "from dataclasses import dataclass\nfrom typing import Annotated\n\nimport numpy as np\n"
        "from annotated_types import Gt\nfrom rkfbench.models.base import Smooth\n\n"
    )
    (folder / "examples.py").write_text(head + "\n".join(textwrap.dedent(each) for each in blocks))
    (folder / "examples.yaml").write_text(EXAMPLES)
    result = rkfbench("run", "examples.yaml")
    assert result.exit_code == 0, result.output
    rows = Results.open("results/examples").summary
    assert {row["metric"] for row in rows} == {"rmse", "examples:worst", "examples:worst[rate]"}
    irregular = "data: {measurements: swing.csv, time: t}\n"
    (folder / "swing.csv").write_text("t,swing\n0,0.1\n0.2,0.2\n0.5,0.1\n")
    recorded = re.sub("(?m)^(seed|runs|steps|start|measurement_noise):.*\n", "", EXAMPLES)
    recorded = recorded.replace("0.01", "0.01, measurement_cov: 0.1").replace(
        'rmse, examples:worst, "examples:worst[rate]"', "nis"
    )
    (folder / "swing.yaml").write_text(recorded + irregular)
    assert rkfbench("run", "swing.yaml").exit_code == 0


@pytest.mark.parametrize(
    ("metric", "message"),
    [
        ("lost", "raised AttributeError: 'Trial' object has no attribute 'errors' (plugins.py, line "),
        ("short", "returned shape (3,), expected (12, 3): a value a step and run"),
    ],
)
def test_an_own_metric_is_tried_before_anything_runs(folder, small, metric, message):
    path = folder / "small.yaml"
    path.write_text(small.read_text().replace("metrics: [", f"metrics: [plugins:likely, plugins:{metric}, "))
    result = rkfbench("validate", path)
    assert result.exit_code == 2
    assert result.stderr.count(f"plugins:{metric} {message}") == 1


def test_a_model_that_cannot_follow_irregular_times_is_told_how(folder):
    (folder / "m.csv").write_text("t,c\n0,1\n1,1\n3,1\n")
    (folder / "walk.yaml").write_text(
        "name: walk\ndata: {measurements: m.csv, time: t}\nmodel: {kind: plugins:Walk}\n"
        "assumed: {mean: [0, 0], cov: 1, process_cov: 1, measurement_cov: 1}\nfilters: [ekf]\nmetrics: [nis]\n"
    )
    result = rkfbench("validate", folder / "walk.yaml")
    assert (result.exit_code, "must be a dataclass with a field `dt`" in result.stderr) == (2, True)
