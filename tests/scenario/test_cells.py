import time

import pytest

from rkfbench.errors import ScenarioError, SpecError
from rkfbench.scenario.expand import between, columns, spaced


def test_readings_cases_and_sweep_points_are_crossed_in_order(change) -> None:
    scenario = change()
    assert [(cell.reading, cell.case) for cell in scenario.cells] == [
        (reading, f"{case},rate={rate}")
        for reading in ("plain", "coins")
        for case in ("near", "far")
        for rate in ("0", "0.2")
    ]
    assert scenario.columns == ("rate",)
    assert [cell.point for cell in scenario.cells[:2]] == [{"rate": 0}, {"rate": 0.2}]


def test_switches_change_the_first_reading_one_at_a_time(change) -> None:
    cells = change().sensitivity
    assert {(cell.reading, cell.switch) for cell in cells} == {("plain", "wide start")}
    assert len(cells) == 4
    assert {cell.spec["assumed"]["cov"] for cell in cells} == {100}


def test_precedence_is_file_reading_case_sweep_option(change) -> None:
    texts = {
        "  plain: {}": "  plain: {steps: 20, model.dt: 20, start.truth: [20, 0, 0, 0], measurement_noise.rate: 0.9}",
        "  far: {": "  far: {model.dt: 30, measurement_noise.rate: 0.8, ",
    }
    far = next(cell for cell in change(texts).cells if cell.case == "far,rate=0.2")
    assert far.spec["steps"] == 20
    assert far.spec["model"]["dt"] == 30
    assert far.spec["start"]["truth"][0] == 100
    assert far.spec["measurement_noise"]["rate"] == 0.2
    every = change(texts, sets=["steps=7", "model.dt=7", "measurement_noise.rate=0.7"]).cells
    assert {cell.case for cell in every} == {"near,rate=0.7", "far,rate=0.7"}
    assert {
        (cell.spec["steps"], cell.spec["model"]["dt"], cell.spec["measurement_noise"]["rate"]) for cell in every
    } == {(7, 7, 0.7)}


def test_without_readings_cases_and_sweeps_there_is_one_cell(change) -> None:
    scenario = change(sets=["readings=null", "cases=null", "sweep=null", "sensitivity=null"])
    assert [(cell.reading, cell.case, cell.point) for cell in scenario.cells] == [("default", "", {})]


def test_a_cell_has_every_default_and_one_entry_a_filter(change) -> None:
    spec = change().cells[0].spec
    assert spec["measurement_noise"]["coin"] == "joint"
    assert spec["measurement_noise"]["outliers"] == {"kind": "laplace", "components": "mixture", "cov": 100}
    assert spec["model"]["dt"] == 1.0
    assert spec["assumed"]["process_cov"] == "law"
    assert [each["label"] for each in spec["filters"]] == ["kf", "hkf", "hkf[threshold=0.5]", "hkf[threshold=3]"]
    assert spec["filters"][3]["threshold"] == 3
    assert spec["filters"][3]["extra"] is True
    assert spec["filters"][1]["root"] == "symmetric"


def test_values_marked_extra_make_extra_cells_without_switches(change) -> None:
    scenario = change({"[0, 0.2]}": "{values: [0.2], extra: {from: 0, to: 0.3, step: 0.1}}}"})
    first = [cell for cell in scenario.cells if cell.reading == "plain" and cell.case.startswith("near")]
    assert [(cell.case, cell.extra) for cell in first] == [
        ("near,rate=0", True),
        ("near,rate=0.1", True),
        ("near,rate=0.2", False),
        ("near,rate=0.3", True),
    ]
    assert {cell.case for cell in scenario.sensitivity} == {"near,rate=0.2", "far,rate=0.2"}


def test_a_case_can_be_extra(change) -> None:
    scenario = change({"  far: {": "  far: {extra: true, "})
    assert {cell.case.split(",")[0]: cell.extra for cell in scenario.cells} == {"near": False, "far": True}


def test_values_that_are_no_word_are_swept_under_labels(change) -> None:
    labelled = "{process_noise: {none: null, small: {kind: gaussian, cov: 1}}}"
    scenario = change({"{measurement_noise.rate: [0, 0.2]}": labelled, "over: rate": "over: process_noise"})
    assert [cell.case for cell in scenario.cells[:2]] == ["near,process_noise=none", "near,process_noise=small"]
    assert scenario.cells[0].spec["process_noise"] is None
    assert scenario.cells[1].point == {"process_noise": "small"}


def test_a_sweep_option_counts_or_lists(change) -> None:
    counted = change(sweeps=["filters.hkf.threshold=0.5:3:6"])
    assert [cell.point["threshold"] for cell in counted.cells[:6]] == [0.5, 1, 1.5, 2, 2.5, 3]
    listed = change(sweeps=["steps=3,4"], sets=["measurement_noise.rate=0"])
    assert [cell.case for cell in listed.cells[:2]] == ["near,rate=0,steps=3", "near,rate=0,steps=4"]


def test_what_an_option_removes_is_not_drawn(change) -> None:
    texts = {"filters: [kf, hkf]}": "filters: [kf, hkf], cases: [rate=0.2]}"}
    assert len(change(texts).figures) == 1
    scenario = change(texts, sets=["measurement_noise.rate=0.5"])
    assert scenario.figures == ()
    assert scenario.resolved["figures"] == []


def test_runs_and_seed_of_the_options_are_in_force(change) -> None:
    scenario = change(runs=3, seed=9)
    assert (scenario.runs, scenario.reference_runs, scenario.seed) == (3, 3, 9)
    assert (change().runs, change().reference_runs) == (4, 8)


def test_a_seed_is_one_that_can_be_read_back(change) -> None:
    assert change(seed=2**63 - 1).seed == 2**63 - 1
    for seed in (2**63, 10**20, -1):
        with pytest.raises(ScenarioError, match=f"--seed {seed}: seed: should be"):
            change(seed=seed)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"sets": ["measurement_noise.rate=0.5", "filters.hkf.root=cholesky"], "runs": 2},
        {"sweeps": ["filters.hkf.threshold=1:2:3"], "seed": 5},
        {"sets": ["measurement_noise.outliers={kind: gaussian, sd: 1e1}"]},
    ],
)
def test_the_resolved_scenario_is_the_same_scenario(change, options, tmp_path) -> None:
    from rkfbench.scenario import load
    from rkfbench.scenario.yaml import dump

    scenario = change(**options)
    (tmp_path / "b.yaml").write_text(dump(scenario.resolved))
    again = load(tmp_path / "b.yaml")
    assert again.cells == scenario.cells
    assert again.sensitivity == scenario.sensitivity
    assert again.resolved == scenario.resolved
    assert (again.runs, again.seed, again.figures) == (scenario.runs, scenario.seed, scenario.figures)


def test_an_override_of_the_kind_leaves_a_scenario_that_can_be_stored(change, tmp_path) -> None:
    from rkfbench.scenario import load
    from rkfbench.scenario.yaml import dump

    texts = {"wide start: {assumed.cov: 100}": "normal outliers: {measurement_noise.outliers.kind: gaussian}"}
    scenario = change(texts)
    (tmp_path / "b.yaml").write_text(dump(scenario.resolved))
    assert load(tmp_path / "b.yaml").sensitivity == scenario.sensitivity


def test_ranges_have_both_ends_and_no_dust() -> None:
    assert spaced(0, 0.5, 0.05)[3] == 0.15
    assert len(spaced(0, 0.5, 0.05)) == 11
    assert between(0, 1, 4) == [0, 0.333333333333, 0.666666666667, 1]
    assert [type(value) for value in spaced(0, 1, 0.5)] == [int, float, int]


@pytest.mark.parametrize("ends", [(0, -1, 1), (0, 1e9, 1e-9), (0, float("inf"), 1), (float("-inf"), 0, 1)])
def test_ranges_without_end_are_refused(ends) -> None:
    with pytest.raises(SpecError):
        spaced(*ends)


def test_columns_are_the_shortest_tails_that_differ() -> None:
    assert columns(["measurement_noise.rate"]) == ["rate"]
    assert columns(["a.x.cov", "b.x.cov", "steps"]) == ["a.x.cov", "b.x.cov", "steps"]
    assert columns(["filters.hkf.threshold", "filters.ukf.threshold"]) == ["hkf.threshold", "ukf.threshold"]
    assert columns(["lost.failed"]) == ["lost.failed"], "a column of the results keeps its name"


def test_a_long_list_of_points_is_refused_at_once(problems) -> None:
    begin = time.process_time()
    (problem,) = problems({"[0, 0.2]": str([each / 1e5 for each in range(20_000)])})
    assert problem.endswith("readings, cases and sweeps make 120000 cells, more than 2000")
    assert time.process_time() - begin < 10  # it took minutes when every point was compared with every other


def test_a_point_that_is_listed_twice_is_named(problems) -> None:
    assert problems({"[0, 0.2]": "[0.1, 0.2, 0.3, 0.2, 0.1]"})[0].endswith("lists 0.1 twice")


def test_cells_times_filters_are_bounded(problems) -> None:
    texts = {"[0, 0.2]": "{from: 0, to: 0.299, step: 0.001}", "threshold: 2}": f"threshold: {list(range(4, 30))}}}"}
    assert "the filters of all cells are more than 20000" in problems(texts)[0]


@pytest.mark.parametrize("filters", ["3", "1e308", "true", "kf", "{use: kf}"])
def test_filters_that_are_no_list_are_told(change, filters) -> None:
    with pytest.raises(ScenarioError, match="filters: should be a valid list"):
        change(sets=[f"filters={filters}"])
