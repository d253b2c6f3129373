import pytest

from rkfbench.errors import ScenarioError, UsageError
from rkfbench.scenario import bundled, load


def test_a_mistyped_key_is_told_with_line_source_and_caret(change) -> None:
    with pytest.raises(ScenarioError) as error:
        change({"  rate: 0.1": "  rat: 0.1"})
    assert str(error.value).splitlines() == [
        "a.yaml:10:3: measurement_noise.rat: unknown key (did you mean 'rate'?)",
        "    rat: 0.1",
        "    ^",
    ]
    assert error.value.exit_code == 2


def test_all_problems_of_a_file_are_told_at_once_from_top_to_end(problems) -> None:
    texts = {
        "seed: 1": "sead: 1",
        "steps: 5": "steps: many",
        "kind: navigation,": "kind: navigatoin,",
        "  rate: 0.1": "  rate: 1.5",
        "  coins: {": "  coins: {mesurement_noise.rate: 1, ",
        "  - kf\n": "  - kff\n",
        "[rmse, ": "[rmsee, ",
        "kind: sweep, over": "kind: swep, over",
    }
    assert problems(texts) == [
        "a.yaml:2:1: sead: unknown key (did you mean 'seed'?)",
        "a.yaml:4:8: steps: should be a valid integer",
        "a.yaml:5:15: model.kind: unknown model 'navigatoin' (did you mean 'navigation'?)",
        "a.yaml:10:9: measurement_noise.rate: should be less than or equal to 1",
        "a.yaml:16:11: readings.coins.mesurement_noise.rate: is not a part of an experiment that can be overridden",
        "a.yaml:24:5: filters.kff.use: unknown filter 'kff' (did you mean 'kf'?)",
        "a.yaml:27:11: metrics.0: unknown metric 'rmsee' (did you mean 'rmse'?)",
        "a.yaml:29:23: figures.rates.kind: unknown kind 'swep' (did you mean 'sweep'?)",
    ]


def test_an_error_from_a_reading_stands_at_the_reading(problems) -> None:
    assert problems({"coin: component": "coin: each"}) == [
        "a.yaml:16:35: measurement_noise.coin: should be 'joint' or 'component'"
    ]


def test_an_error_from_an_option_names_the_option(problems) -> None:
    assert problems(sets=["measurement_noise.rate=2"]) == [
        "--set measurement_noise.rate=2: measurement_noise.rate: should be less than or equal to 1"
    ]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sets": ["steps"]}, "--set steps: should be written as path=value"),
        ({"sets": ["nothing.here=1"]}, "leads nowhere: there is no 'nothing'"),
        ({"sets": ["filters.hfk.threshold=1"]}, "there is no entry 'hfk' (did you mean 'hkf'?)"),
        ({"sets": ["steps=[1"]}, "--set steps=[1: did not find expected"),
        ({"sets": ["steps=.nan"]}, "NaN is not a value"),
        ({"sets": ["\udcff=1"]}, "is not UTF-8 text"),
        ({"sets": ["notes=\ud800"]}, "is not UTF-8 text"),
        ({"sweeps": ["\udcff=1:2:3"]}, "is not UTF-8 text"),
        ({"sweeps": ["steps=1:2"]}, "steps: should be a valid integer"),
        ({"sweeps": ["steps=1:9:x"]}, "path=first:last:count"),
        ({"runs": 0}, "--runs 0: runs.paper: should be greater than or equal to 1"),
        ({"seed": -1}, "--seed -1: seed: should be greater than or equal to 0"),
    ],
)
def test_options_that_make_no_sense_are_refused(problems, options, message) -> None:
    assert message in problems(options.pop("texts", None), **options)[0]


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (
            {"truth: [0, 0, 1, 1]": "truth: [0, 0, 1]"},
            "a.yaml:6:16: start.truth: has 3 elements, the model has 4 states",
        ),
        (
            {"cov: 1}\n  out": "cov: [[1, 2], [2, 1]]}\n  out"},
            "measurement_noise.body.cov: a covariance must not be indefinite",
        ),
        ({"measurement_cov: body": "measurement_cov: bodie"}, "assumed.measurement_cov: 'bodie'"),
        ({'"rmse[px]"': '"rmse[pz]"'}, "metrics.1: the model has no state 'pz'"),
        ({'"rmse[px]"': '"mse@77"'}, "metrics.1: steps 77..77 are not within 1..5"),
        (
            {"threshold: [0.5, 3]": "threshold: [0.5, -3]"},
            "filters.hkf[threshold=-3].threshold: should be greater than 0",
        ),
        ({"  - kf\n": "  - kf\n  - kf\n"}, "a.yaml:25:5: filters.1: two filters are labelled 'kf'"),
        ({"metric: rmse, f": "metric: mse, f"}, "figures.rates.metric: no metric 'mse' here (did you mean 'rmse'?)"),
        ({"over: rate": "over: rates"}, "figures.rates.over: no swept parameter 'rates' here (did you mean 'rate'?)"),
        ({"filters: [kf, hkf]}": "filters: [kf, ukf]}"}, "figures.rates.filters.1: no filter 'ukf' here"),
        ({"name: small": "name: small\npaper: none-2000"}, "a.yaml:2:8: paper: no paper file 'none-2000'"),
        ({"rate: [0, 0.2]": "rate: [0, no]"}, "measurement_noise.rate: should be a valid number"),
        ({"rate: [0, 0.2]": "rate: {from: 0, to: 1}"}, "sweep.measurement_noise.rate.step: is required"),
        ({"rate: [0, 0.2]": "rate: {from: 0, to: 1, step: 1e-9}"}, "makes no sensible range"),
        ({"rate: [0, 0.2]": "rate: [0, 0.2, 0.2]"}, "a.yaml:22:9: sweep.measurement_noise.rate: lists 0.2 twice"),
        ({"  near: {}": "  a=b: {}"}, "cases.a=b: should match pattern"),
        ({"rate: [0, 0.2]": "rate: [0, [1]]"}, "sweep.measurement_noise.rate.1: should be a valid number"),
        ({"rate: [0, 0.2]": "rate: {from: 0, to: 1, step: 1e-3}, steps: {from: 1, to: 9, step: 1}"}, "sensible range"),
        ({"steps: 5\n": ""}, "a.yaml:1:1: steps: is required"),
        ({"  plain: {}": "  plain: {steps: null}"}, "a.yaml:15:18: steps: is required"),
        ({"steps: 5": "steps: true"}, "steps: should be a valid integer"),
        ({"seed: 1": 'seed: "1"'}, "seed: should be a valid integer"),
        ({"name: small": "name: ../small"}, "name: should match pattern"),
        ({"name: small": f"name: {'x' * 101}"}, "name: should have at most 100 characters"),
    ],
)
def test_what_makes_no_sense_is_told_where_it_stands(problems, texts, message) -> None:
    assert message in problems(texts)[0]


CONTROL = "a name holds no line breaks and other control characters"


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        ({"  coins:": "  plain+coins:"}, "a.yaml:16:16: readings.plain+coins: the name of a reading holds no `+`"),
        (
            {"  coins:": '  "a b": {}\n  a-b:'},
            "a.yaml:17:3: readings.a-b: files cannot be called after both 'a b' and 'a-b'",
        ),
        (
            {"  wide start:": "  wide-start: {assumed.cov: 9}\n  wide start:"},
            "a.yaml:19:3: sensitivity.wide start: files cannot be called after both 'plain+wide-start' and",
        ),
        (
            {"  coins:": "  plain-wide-start:"},
            "a.yaml:18:3: sensitivity.wide start: files cannot be called after both 'plain-wide-start' and",
        ),
        ({"  coins:": '  "a\\rb":'}, f"a.yaml:16:11: readings.a\\rb: {CONTROL}"),
        ({"  wide start:": '  "a\\x85b":'}, f"sensitivity.a\\x85b: {CONTROL}"),
        ({"  near:": '  "a\\tb":'}, f"cases.a\\tb: {CONTROL}"),
        ({"  - kf\n": '  - {use: kf, label: "a\\nb"}\n'}, f"filters.a\\nb.label: {CONTROL}"),
        (
            {"rate: [0, 0.2]": 'coin: ["joint\\r"]'},
            f"a.yaml:22:9: sweep.measurement_noise.coin: {CONTROL}",
        ),
        (
            {"rate: [0, 0.2]": 'rate: {"0,rate=0.2": 0, "0.2": 0.2}'},
            "a.yaml:22:9: sweep.measurement_noise.rate: '0,rate=0.2' holds a comma, which parts the name of a case",
        ),
    ],
)
def test_names_that_the_results_would_confuse_are_refused(problems, texts, message) -> None:
    assert any(message in each for each in problems(texts))


def test_the_same_fault_in_many_cells_is_told_once(problems) -> None:
    assert len(problems({"mean: [0, 0, 0, 0]": "mean: [0, 0, 0, a]"})) == 1


def test_what_is_neither_a_file_nor_bundled_gets_a_suggestion(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError, match=r"no scenario 'contamination-rate'.*did you mean 'contamination-rates'"):
        load("contamination-rate")
    with pytest.raises(UsageError, match=r"^none\.yaml: no such file"):
        load("none.yaml")
    with pytest.raises(UsageError, match="is a directory"):
        load(tmp_path)


@pytest.mark.parametrize("name", bundled())
def test_every_bundled_scenario_is_valid_and_called_like_its_file(name) -> None:
    assert load(name).name == name


@pytest.mark.parametrize("name", bundled())
def test_every_bundled_scenario_can_be_stored_and_run_again(name, tmp_path) -> None:
    from rkfbench.scenario.yaml import dump

    scenario = load(name)
    (tmp_path / "b.yaml").write_text(dump(scenario.resolved), encoding="utf-8")
    again = load(tmp_path / "b.yaml")
    assert (again.cells, again.sensitivity, again.resolved) == (scenario.cells, scenario.sensitivity, scenario.resolved)


def test_the_contamination_study_has_the_papers_cases_under_two_readings() -> None:
    scenario = load("contamination-rates")
    for reading in ("literal", "root"):
        rates = [cell.point["rate"] for cell in scenario.cells if cell.reading == reading and not cell.extra]
        assert rates == sorted(rates)
        assert {0, 0.05, 0.2, 0.3, 0.4} <= set(rates)
    assert (scenario.runs, scenario.cells[0].spec["steps"]) == (100, 500)
    assert len({cell.switch for cell in scenario.sensitivity}) == 12


def test_a_name_for_what_is_not_there_is_an_error(change, problems) -> None:
    names = "names: {rate: share of outliers, near: close by, kf: the KF, rmse: error, rate=0.2: many}\nsteps: 5"
    assert change({"steps: 5": names}).names["rate"] == "share of outliers"
    assert problems({"steps: 5": names.replace("near:", "neer:")}) == [
        "a.yaml:4:40: names.neer: no case, sweep column, filter or metric 'neer' here (did you mean 'near'?)"
    ]


@pytest.mark.parametrize("model", ["3", "[]", "navigation", "~"])
def test_a_model_with_a_known_input_that_is_no_mapping_is_told(problems, model) -> None:
    texts = {"model: {kind: navigation, observed: [px, py]}": f"model: {model}\ninput: {{value: 1}}"}
    assert any(each.startswith("a.yaml:5:") and ": model: " in each for each in problems(texts))


def test_the_caveat_of_a_reading_is_no_override(change) -> None:
    scenario = change({"  plain: {}": "  plain: {caveat: A guess.}"})
    assert scenario.caveats == {"plain": "A guess."}
    assert [scenario.caveat(name) for name in ("plain", "plain+wide start", "coins")] == ["A guess.", "A guess.", ""]
    assert [cell.spec for cell in scenario.cells] == [cell.spec for cell in change().cells]
    assert scenario.resolved["readings"]["plain"] == {"caveat": "A guess."}


def test_a_caveat_is_a_text(problems) -> None:
    (told,) = problems({"  plain: {}": "  plain: {caveat: 3}"})
    assert "readings.plain.caveat" in told


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("  - kf\n", f"  - {'f' * 5000}.py:f\n", "there is no file f"),
        ("seed: 1", f"data: {{measurements: {'d' * 5000}}}\nseed: 1", "there is no file .*d"),
    ],
)
def test_a_name_too_long_for_a_file_is_that_of_none(change, old: str, new: str, message: str) -> None:
    with pytest.raises(UsageError, match="no scenario 'nnn"):
        load("n" * 5000)
    with pytest.raises(ScenarioError, match=message):
        change({old: new})
