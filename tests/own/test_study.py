"""Own filters in a study: resume by the hash of their sources, worker processes, stored scenarios, faults."""

import json
from pathlib import Path

import pytest
import yaml

from rkfbench.errors import InputChanged
from rkfbench.pool import Pool
from rkfbench.scenario import load
from rkfbench.store import Results
from rkfbench.study import engines, plan
from rkfbench.study.events import Looped, Recomputing
from rkfbench.study.run import run_study
from tests.conftest import SMALL
from tests.test_cli import rkfbench

FILTERS = "filters: [kf, {use: plugins.py:stepwise, inflate: [1, 4]}, plugins:whole]"
OWN = SMALL.replace("filters: [kf, {use: hkf, threshold: 2}]", FILTERS)


@pytest.fixture
def scenario(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(folder)
    path = folder / "small.yaml"
    path.write_text(OWN)
    return path


def study(path, folder, **more):
    events = []
    outcome = run_study(load(path), folder, report=events.append, **more)
    return outcome, [event.reason for event in events if isinstance(event, Recomputing)], events


def test_own_filters_stand_beside_the_catalogues(scenario, tmp_path):
    _, _, events = study(scenario, tmp_path / "r")
    results = Results.open(tmp_path / "r")
    kf, mine, whole = (
        results.values("default", "rate=0.4", label, "err_norm") for label in ("kf", "stepwise[inflate=1]", "whole")
    )
    assert kf == pytest.approx(mine, rel=1e-9)
    assert kf == pytest.approx(whole, rel=1e-9)
    looped = [event for event in events if isinstance(event, Looped)]
    assert [event.filter for event in looped] == ["stepwise[inflate=1]", "stepwise[inflate=4]", "whole"]
    assert all(event.ratio > 1 and event.seconds > 0 for event in looped)


def test_numbers_are_used_again_until_the_source_changes(scenario, tmp_path):
    study(scenario, tmp_path / "r")
    assert study(scenario, tmp_path / "r")[0].computed == 0
    (scenario.parent / "unrelated.py").write_text("")
    assert study(scenario, tmp_path / "r")[0].computed == 0
    with (scenario.parent / "helper.py").open("a") as file:
        file.write("# better\n")
    outcome, reasons, _ = study(scenario, tmp_path / "r")
    assert (outcome.computed, reasons) == (2, ["source of plugins.py:stepwise changed"])


def test_only_the_numbers_of_the_changed_filter_are_computed(scenario, tmp_path):
    (scenario.parent / "other.py").write_text(
        "from rkfbench.filters import build\n\n\ndef mine():\n    return build('kf')\n"
    )
    scenario.write_text(OWN.replace("plugins:whole", "other:mine"))
    study(scenario, tmp_path / "r")
    with (scenario.parent / "other.py").open("a") as file:
        file.write("# better\n")
    jobs = []

    def engine(work):
        jobs.extend(work)
        return engines.serial(work)

    study(scenario, tmp_path / "r", engine=engine)
    assert {job.labels for job in jobs} == {("mine",)}


def test_numbers_measured_against_a_changed_filter_are_computed_too(scenario, tmp_path):
    against = OWN.replace("metrics: [err_norm", "metrics: ['distance(to=whole)', err_norm")
    against = against.replace("filters: [kf, {use: plugins.py:stepwise, inflate: [1, 4]}", "filters: [kf, hkf")
    scenario.write_text(against)
    study(scenario, tmp_path / "r")
    with (scenario.parent / "plugins.py").open("a") as file:
        file.write("# better\n")
    units = plan.units(load(scenario), tmp_path / "r", full=False)
    looked_up = [plan.look_up(unit) for unit in units]
    assert {each.missing for each in looked_up} == {("kf", "hkf", "whole")}
    assert {each.reason for each in looked_up} == {"source of plugins:whole changed"}


def test_a_model_that_raises_is_named(scenario):
    (scenario.parent / "late.py").write_text(
        "from plugins import Walk\n\n\nclass Late(Walk):\n    def f(self, x, k):\n"
        "        if k > 3:\n            raise ValueError('too late')\n        return x\n"
    )
    text = OWN.replace(FILTERS, "filters: [ekf, ukf]").replace("1, 1, 1, 1", "1, 1").replace("0, 0, 0, 0", "0, 0")
    lines = ["model: {kind: 'late:Late'}" if line.startswith("model:") else line for line in text.splitlines()]
    scenario.write_text("\n".join(lines))
    result = rkfbench("run", scenario)
    assert result.exit_code == 1
    assert "filter ukf, block 0: late:Late raised ValueError: too late (late.py, line 7)" in result.stderr


def test_worker_processes_find_the_plugins_and_give_the_same_bytes(scenario, tmp_path):
    study(scenario, tmp_path / "a")
    with Pool(2) as pool:
        study(scenario, tmp_path / "b", engine=lambda jobs: engines.processes(jobs, pool))
    for name in ("runs.csv", "summary.csv", "series.csv", "scenario.yaml"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_a_plugin_that_changes_while_a_study_runs_ends_it_and_what_is_finished_is_kept(scenario, tmp_path):
    source = scenario.parent / "helper.py"
    before = source.read_text()

    def engine(jobs):
        for job in jobs:
            yield from engines.serial(job.singles())
            source.write_text(before + "# better\n")

    scenario.write_text(OWN + "readings: {a: {}, b: {assumed.cov: 2}}\n")
    with pytest.raises(InputChanged, match=r"the source of .* was changed while the study ran"):
        study(scenario, tmp_path / "r", engine=engine)
    assert not (tmp_path / "r/summary.csv").exists()
    source.write_text(before)
    assert study(scenario, tmp_path / "r")[0].computed == 2


def test_copies_are_the_plugins_that_made_the_numbers(scenario, tmp_path):
    source = scenario.parent / "helper.py"
    before = source.read_text()

    def engine(jobs):
        yield from engines.serial(jobs)
        source.write_text(before + "# better\n")

    study(scenario, tmp_path / "r", engine=engine)
    assert (tmp_path / "r/plugins/helper.py").read_text() == before
    assert study(tmp_path / "r/scenario.yaml", tmp_path / "r")[0].computed == 0


def test_a_plugin_that_reads_a_file_is_rendered_from_its_copy(scenario, tmp_path):
    (scenario.parent / "gain.txt").write_text("0.5\n")
    (scenario.parent / "reader.py").write_text(
        "from pathlib import Path\n\nimport numpy as np\n\nREADS = ['gain.txt']\n"
        "GAIN = np.loadtxt(Path(__file__).with_name('gain.txt'))\n\n\n"
        "def mine(model, y, x0, P0, Q, R):\n    return np.full((len(y), len(x0)), GAIN)\n"
    )
    scenario.write_text(OWN.replace("plugins:whole", "reader.py:mine"))
    assert rkfbench("run", scenario, "-q").exit_code == 0
    (scenario.parent / "gain.txt").unlink()
    assert rkfbench("report", "results/small").exit_code == 0
    assert Path("results/small/plugins/gain.txt").read_text() == "0.5\n"


def test_the_stored_scenario_runs_again_elsewhere(scenario, tmp_path, tmp_path_factory):
    study(scenario, tmp_path / "r")
    assert yaml.safe_load((tmp_path / "r/scenario.yaml").read_text())["plugins"] == "plugins"
    elsewhere = tmp_path_factory.mktemp("elsewhere") / "r"
    (tmp_path / "r").rename(elsewhere)
    for name in ("plugins.py", "helper.py"):
        (scenario.parent / name).unlink()
    before = (elsewhere / "runs.csv").read_bytes()
    outcome, _, _ = study(elsewhere / "scenario.yaml", elsewhere)
    assert outcome.computed == 0
    outcome, _, _ = study(elsewhere / "scenario.yaml", elsewhere, fresh=True)
    assert (outcome.computed, (elsewhere / "runs.csv").read_bytes()) == (2, before)
    assert sorted(path.name for path in (elsewhere / "plugins").iterdir()) == ["helper.py", "plugins.py"]


def test_a_scenario_without_plugins_is_stored_as_before(tmp_path, small):
    study(small, tmp_path / "r")
    assert "plugins" not in (tmp_path / "r/scenario.yaml").read_text()
    assert not (tmp_path / "r/plugins").exists()


def test_another_folder_of_plugins_can_be_named(scenario, tmp_path):
    (tmp_path / "deep").mkdir()
    inner = tmp_path / "deep/small.yaml"
    inner.write_text(OWN + "plugins: ..\n")
    assert [each["use"] for each in load(inner).cells[0].spec["filters"]][1] == "plugins.py:stepwise"


def test_own_parts_are_named_in_overrides_and_figures(scenario):
    scenario.write_text(
        OWN + "figures: [{id: f, kind: sweep, over: stepwise.inflate, metric: err_norm}]\n"
        "cases: {normal: {}, heavy: {measurement_noise: {kind: 'plugins:student', nu: 3},"
        " assumed.measurement_cov: law}}\n"
    )
    scenario.write_text(scenario.read_text().replace("sweep: {measurement_noise.rate: [0, 0.4]}\n", ""))
    heavy = load(scenario, sets=["filters.whole.label=other"]).cells[1].spec
    assert set(heavy["plugins"]["sources"]) == {"plugins.py:stepwise", "plugins:whole", "plugins:student"}
    assert heavy["measurement_noise"] == {"kind": "plugins:student", "nu": 3}
    assert heavy["filters"][-1]["label"] == "other"


def test_an_error_in_a_plugin_is_told_at_its_line_and_nothing_runs(scenario):
    scenario.write_text(OWN.replace("plugins:whole", "plugins:whale").replace("inflate: [1, 4]", "inflate: [1, -4]"))
    result = rkfbench("run", scenario)
    assert result.exit_code == 2
    assert "small.yaml:16:55: filters.stepwise[inflate=-4].inflate: should be greater than 0" in result.stderr
    assert "small.yaml:16:61: filters.whale.use: plugins has no 'whale' (did you mean 'whole'?)" in result.stderr
    assert not Path("results").exists()


def test_a_plugin_that_raises_is_one_message_and_the_others_complete(scenario):
    raising = OWN.replace("plugins:whole", "plugins:in_place")
    scenario.write_text(raising.replace("rate: [0, 0.4]", "rate: [0, 0.1, 0.2, 0.3, 0.4]"))
    result = rkfbench("run", scenario)
    assert result.exit_code == 1
    told = [line for line in result.stderr.splitlines() if "in_place" in line]
    assert told[0] == (
        "small: case rate=0 (default), filter in_place, block 0: plugins:in_place in run 0 changes its argument y in "
        "place (x = x + d instead of x += d leaves it as it is)"
    )
    assert told[3:] == ["small: filter in_place: 2 more failures (-v tells all)"]
    assert {row["filter"] for row in Results.open("results/small").summary} == {
        "kf",
        "stepwise[inflate=1]",
        "stepwise[inflate=4]",
    }
    assert Path("results/small/claims.csv").exists(), "what can be made of them is made"
    assert rkfbench("verify", "results/small").exit_code == 0


def test_nothing_is_left_to_write_when_every_filter_raises(scenario):
    scenario.write_text(SMALL.replace("[kf, {use: hkf, threshold: 2}]", "[plugins:transposed]"))
    result = rkfbench("run", scenario)
    assert result.exit_code == 1
    assert "returned means of shape (4, 12), expected (12, 4)" in result.stderr
    assert json.loads(Path("results/small/manifest.json").read_text())["incomplete"]


def test_studies_with_plugins_of_their_own_do_not_disturb_each_other(scenario, tmp_path, tmp_path_factory):
    """The same names mean other files in another folder."""
    other = tmp_path_factory.mktemp("other") / "second.yaml"
    text = scenario.read_text()
    scenario.write_text(text.replace("name: small", "name: first"))
    other.write_text(text.replace("name: small", "name: second"))
    for name in ("plugins.py", "helper.py"):
        (other.parent / name).write_text((scenario.parent / name).read_text() + "\n# the other one\n")
    result = rkfbench("run", scenario, other, "--jobs", "2", "--out", tmp_path / "r")
    assert result.exit_code == 0, result.output
    for source in (scenario, other):
        folder = tmp_path / "r" / yaml.safe_load(source.read_text())["name"]
        for name in ("plugins.py", "helper.py"):
            assert (folder / "plugins" / name).read_text() == (source.parent / name).read_text()
        assert (folder / "summary.csv").exists()


MEASURED = "def {name}(trial, states):\n    return trial.estimate.mean[:, states[0]] - trial.truth()[:, states[0]]\n"
OF_ITS_OWN = """
claims: [{id: c, says: it does, ordering: {metric: "mine.py:NAME", filters: [kf, hkf], cases: rate=0.4}}]
tables: [{id: t, metric: "mine.py:NAME"}]
figures: [{id: f, kind: sweep, over: rate, metric: "mine.py:NAME"}]
"""


@pytest.mark.parametrize("more", [["--jobs", "1"], ["--jobs", "2"], ["--precision", "9"], ["--shard", "1/1"]])
def test_studies_with_metrics_of_their_own_do_not_disturb_each_other(tmp_path, tmp_path_factory, more):
    paths = []
    for name in ("first", "second"):
        paths.append(tmp_path_factory.mktemp(name) / "s.yaml")
        text = SMALL.replace("name: small", f"name: {name}") + OF_ITS_OWN.replace("NAME", name)
        paths[-1].write_text(text.replace("[err_norm,", f'["mine.py:{name}", err_norm,'))
        (paths[-1].parent / "mine.py").write_text(MEASURED.format(name=name))
    result = rkfbench("run", *paths, *more, "--out", tmp_path / "r")
    assert result.exit_code == 0, result.output
    if "--shard" not in more:
        assert {path.parents[1].name for path in (tmp_path / "r").glob("*/tables/t.csv")} == {"first", "second"}
        for command in ("verify", "report"):
            again = rkfbench(command, tmp_path / "r/first", tmp_path / "r/second")
            assert again.exit_code == 0, again.output


RECORDED = """\
name: drive
data: {measurements: drive.csv, time: t}
model: {kind: navigation, dt: 0.5, observed: [px, py]}
assumed: {mean: [0, 0, 8, 3], cov: 1, process_cov: 0.1, measurement_cov: 1}
filters: [kf, plugins:paced]
metrics: [nis, whiteness, log_likelihood]
"""


@pytest.fixture
def recorded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario with two recordings: irregular times, single missing components, no truth."""
    monkeypatch.chdir(folder)
    (folder / "drive.csv").write_text((Path(__file__).parents[1] / "data/drive.csv").read_text())
    path = folder / "drive.yaml"
    path.write_text(RECORDED)
    return path


def test_an_own_filter_is_measured_on_a_recording_without_a_truth(recorded):
    assert rkfbench("run", recorded).exit_code == 0
    results = Results.open("results/drive")
    for metric in ("nis", "whiteness", "log_likelihood"):
        kf, mine = (results.values("default", "", label, metric) for label in ("kf", "paced"))
        assert mine == pytest.approx(kf, rel=1e-9)


def test_a_filter_that_cannot_follow_irregular_times_is_refused_at_its_line(recorded):
    recorded.write_text(RECORDED.replace("paced", "stepwise"))
    result = rkfbench("validate", recorded)
    assert result.exit_code == 2
    assert "drive.yaml:5:15: filters.stepwise: Q changes with time here" in result.stderr


def test_what_an_own_filter_does_not_have_is_said_and_nothing_at_all_is_refused(recorded):
    regular = RECORDED.replace(", time: t", "")
    recorded.write_text(regular.replace("paced", "whole"))
    for command in ("validate", "run"):
        result = rkfbench(command, recorded)
        assert result.exit_code == 0
        assert "drive: whole has no nu, S: nis, whiteness, log_likelihood not measured" in result.stderr
    recorded.write_text(regular.replace("kf, plugins:paced", "plugins:whole"))
    result = rkfbench("validate", recorded)
    assert (result.exit_code, "nothing would be measured: whole has no nu, S" in result.stderr) == (2, True)
    assert "not measured" not in rkfbench("validate", Path(__file__).parents[1] / "data/drive.yaml").stderr


def test_runs_that_failed_are_counted_and_the_first_is_told(recorded):
    recorded.write_text(RECORDED.replace(", time: t", "").replace("paced", "naive"))
    result = rkfbench("run", recorded)
    assert result.exit_code == 0
    (line,) = (line for line in result.stderr.splitlines() if "failed" in line)
    assert line.startswith("drive: naive: 2 of 2 runs failed; first: the only case (default), run 0, step ")
    assert "x is not finite (y has missing components, NaN: use those where np.isfinite(y))" in line


def test_a_plugin_that_leaves_python_is_a_failure_of_its_own(scenario):
    scenario.write_text(OWN.replace("plugins:whole", "plugins:leaves"))
    result = rkfbench("run", scenario)
    assert result.exit_code == 1
    assert "plugins:leaves raised SystemExit in run 0, step 1: 3 (plugins.py, line " in result.stderr
