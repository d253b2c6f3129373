"""rkfbench check and rkfbench new."""

import json
from pathlib import Path

import pytest

from rkfbench import contract
from rkfbench.catalogue import Limit
from rkfbench.filters import build
from rkfbench.filters.base import Estimate
from tests.test_cli import rkfbench


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_the_catalogue_and_own_filters_pass(folder):
    result = rkfbench("check", "plugins.py:stepwise", "--set", "inflate=2")
    assert (result.exit_code, result.stdout.count("8 checks passed")) == (0, 3), result.output
    assert "not for recordings with irregular times: Q changes with time here, and predict of" in result.stderr
    hkf, paced = rkfbench("check", "hkf"), rkfbench("check", "plugins.py:paced")
    assert [(each.exit_code, "irregular" in each.stderr) for each in (hkf, paced)] == [(0, False)] * 2


def test_findings_are_sentences_and_the_exit_code_is_one(folder):
    (folder / "bad.py").write_text(
        "import numpy as np\n\n\n"
        "def guess(model, y, x0, P0, Q, R):\n"
        "    return np.random.standard_normal((len(y), len(x0))), np.tile(-np.eye(len(x0)), (len(y), 1, 1))\n"
    )
    result = rkfbench("check", folder / "bad.py:guess", "--json")
    assert result.exit_code == 1
    found = {each["check"]: each["findings"] for each in json.loads(result.stdout) if each["problem"] == "navigation"}
    assert found["shapes"] == []
    assert "P is not positive definite" in found["covariances"][0]
    assert "draws from the global random numbers" in found["randomness"][0]


def test_a_filter_is_tried_on_the_scenario_that_it_serves(folder, small):
    (folder / "special.py").write_text(
        "from plugins import stepwise\n\n\nclass mine(stepwise):\n"
        "    def __init__(self, model, x0, P0, Q, R):\n"
        "        assert model.states[0] == 'px' and len(y := model.measurements) == 3, y\n"
        "        super().__init__(model, x0, P0, Q, R)\n"
    )
    alone = rkfbench("check", "special:mine")
    assert (alone.exit_code, "special:mine on range_bearing, shapes: special:mine raised" in alone.stdout) == (1, True)
    on = rkfbench("check", "special:mine", "--on", small)
    assert (on.exit_code, on.stdout) == (0, "special:mine on small: 8 checks passed\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plugins:nothing"], "plugins has no 'nothing'"),
        (["plugins:stepwise", "--set", "inflate=0"], "inflate: should be greater than 0"),
        (["hfk"], "did you mean 'hkf'"),
        (["two.py"], "which function or class of two.py? Write two.py:NAME (it has one, another)"),
        (["two.py:"], "which function or class of two.py? Write two.py:NAME"),
        (["two.py:mp"], "two.py has no 'mp'\n"),
        (["plugins:stepwise", "--set", "inflate"], "--set inflate: should be written as PARAMETER=VALUE"),
    ],
)
def test_what_is_no_filter_is_a_usage_error(folder, arguments, message):
    (folder / "two.py").write_text("import numpy as np\n\n\ndef one(): ...\n\n\nclass another: ...\n")
    result = rkfbench("check", *arguments)
    assert (result.exit_code, message in result.stderr) == (2, True)


class Wrong:
    """A filter whose estimates `change` spoils, so that each check can be seen to find something."""

    def __init__(self, change):
        self.change, self.calls = change, 0
        self.sees = frozenset({"cov", "prior_mean", "prior_cov"})

    def run(self, model, y, x0, P0, *, Q, R, keep=("cov",), known=None, streams=None):
        estimate = build("kf").run(model, y, x0, P0, Q=Q, R=R, keep=("cov", "prior_mean", "prior_cov"))
        self.calls += 1
        mean, cov, failed = self.change(estimate, y, self.calls)
        return Estimate(mean, cov, failed, dict(estimate.extras))


def _writes(e, y, calls):
    y += 1
    return e.mean, e.cov, e.failed


def test_random_numbers_of_the_run_and_missing_values_are_no_fault(folder):
    assert list(contract.batches(contract.Subject(build("plugins:noisy"), contract.problems()[0]))) == []
    csv = Path(__file__).parents[1] / "data/drive.csv"
    (folder / "drive.yaml").write_text(
        f"name: drive\ndata: {{measurements: {csv}}}\nmodel: {{kind: navigation, dt: 0.5, observed: [px, py]}}\n"
        "assumed: {mean: [0, 0, 8, 3], cov: 1, process_cov: 0.1, measurement_cov: 1}\nfilters: [kf]\nmetrics: [nis]\n"
    )
    on = rkfbench("check", "plugins.py:paced", "--on", folder / "drive.yaml")
    assert (on.exit_code, on.stdout) == (0, "plugins.py:paced on drive: 8 checks passed\n")
    assert rkfbench("check", "kf", "--on", folder / "drive.yaml").exit_code == 0


def test_a_single_missing_component_is_tried(folder):
    found = list(contract.missing(contract.Subject(build("plugins:naive"), contract.problems()[0])))
    assert found == ["a missing component (NaN in y) makes every run fail: use those where np.isfinite(y)"]


@pytest.mark.parametrize(
    ("check", "change", "message"),
    [
        (contract.shapes, lambda e, y, calls: (e.mean[:, :1], e.cov, e.failed), "means have shape"),
        (contract.shapes, lambda e, y, calls: (e.mean, e.cov, e.failed[:1]), "`failed` has shape"),
        (contract.shapes, lambda e, y, calls: (e.mean * float("nan"), e.cov, e.failed), "not finite"),
        (contract.shapes, lambda e, y, calls: (e.mean, e.cov, ~e.failed), "every run fails"),
        (contract.covariances, lambda e, y, calls: (e.mean, -e.cov, e.failed), "not positive definite"),
        (contract.covariances, lambda e, y, calls: (e.mean, e.cov.cumsum(2), e.failed), "not symmetric"),
        (contract.batches, lambda e, y, calls: (e.mean + y.shape[2], e.cov, e.failed), "by itself gives other"),
        (
            contract.alone,
            lambda e, y, calls: (e.mean + e.failed.sum(), e.cov, e.failed),
            "change the estimates of others",
        ),
        (contract.alone, lambda e, y, calls: (e.mean, e.cov, e.failed & False), "not marked as failed"),
        (contract.missing, lambda e, y, calls: (e.mean + 1, e.cov, e.failed), "mean is not the predicted one"),
        (contract.missing, lambda e, y, calls: (e.mean, 2 * e.cov, e.failed), "covariance is not the predicted one"),
        (contract.inputs, _writes, "changes its argument y"),
        (
            contract.stepped,
            lambda e, y, calls: (e.mean + calls, e.cov, e.failed),
            "give other estimates than told once",
        ),
        (contract.randomness, lambda e, y, calls: (e.mean + calls, e.cov, e.failed), "run again on the same data"),
    ],
)
def test_every_check_finds_what_it_is_for(check, change, message):
    problem = contract.Problem.of("navigation", contract.SPECS["navigation"])
    assert list(check(contract.Subject(build("kf"), problem))) == []
    assert message in " ".join(check(contract.Subject(Wrong(change), problem)))


def test_a_limit_that_does_not_hold_is_found():
    problem = contract.problems()[0]

    def make(**params):
        return build("hkf", **params)

    assert list(contract.limit_holds(make, Limit({"threshold": 1e9}, "kf"), problem)) == []
    assert "not equal to kf" in next(contract.limit_holds(make, Limit({"threshold": 1.0}, "kf"), problem))


def test_check_tries_the_limits_that_a_filter_declares(folder):
    (folder / "huber.py").write_text(
        "from rkfbench.catalogue import Limit\nfrom rkfbench.filters import build\n\n\n"
        "def mine(threshold=1.0, limits=3):\n    return build('hkf', threshold=threshold)\n\n\n"
        "def claims(threshold=1.0):\n    return build('hkf', threshold=threshold)\n\n\n"
        "claims.limits = (Limit({'threshold': 1e9}, 'kf'), Limit({'threshold': 2.0}, 'kf'))\n"
    )
    result = rkfbench("check", "huber:claims")
    assert result.exit_code == 1
    assert "huber:claims on navigation, limit 2: with {'threshold': 2.0} it is not equal to kf" in result.stdout
    assert "limit 1" not in result.stdout
    assert rkfbench("check", "huber:mine").exit_code == 0


@pytest.mark.parametrize("options", [[], ["--batch"]])
def test_a_new_filter_passes_and_runs(options):
    assert rkfbench("new", "filter", "mine", *options).stdout == "mine.py\nmine.yaml\n"
    checked = rkfbench("check", "mine.py:mine")
    assert (checked.exit_code, checked.stdout.count("8 checks passed")) == (0, 3), checked.output
    ran = rkfbench("run", "mine.yaml", "--runs", "5", "--out", "r")
    assert ran.exit_code == 0, ran.output
    assert "| KF | HKF | mine |" in Path("r/tables/errors.md").read_text()


def test_a_new_scenario_is_valid():
    assert rkfbench("new", "scenario", "first-try").stdout == "first-try.yaml\n"
    assert rkfbench("validate", "first-try.yaml").exit_code == 0
    assert "numbers, tables and figures in results/first-try" in Path("first-try.yaml").read_text()  # and no report


def test_nothing_is_written_over():
    Path("mine.yaml").write_text("precious")
    result = rkfbench("new", "filter", "mine")
    assert (result.exit_code, Path("mine.yaml").read_text(), Path("mine.py").exists()) == (2, "precious", False)


@pytest.mark.parametrize(
    ("what", "name"),
    [
        ("filter", "my-filter"),
        ("filter", "class"),
        ("filter", "kf"),
        ("filter", "größe"),
        ("filter", "n" * 101),
        ("filter", "true"),
        ("scenario", "a/b"),
        ("scenario", "n" * 120),
        ("scenario", "12"),
    ],
)
def test_a_name_that_cannot_be_one_is_refused(what, name):
    assert rkfbench("new", what, name).exit_code == 2
    assert list(Path().iterdir()) == []


def test_new_names_no_file_twice_and_hides_no_module():
    assert rkfbench("new", "scenario", "first.yaml").stdout == "first.yaml\n"
    hiding = rkfbench("new", "filter", "numpy")
    assert (hiding.exit_code, "'numpy' is a module that Python can import" in hiding.stderr) == (2, True)
    assert not Path("numpy.py").exists()
