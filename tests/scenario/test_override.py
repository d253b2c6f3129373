import pytest

from rkfbench.errors import SpecError
from rkfbench.scenario.locate import locate
from rkfbench.scenario.override import add_sweep, graft, set_value
from rkfbench.scenario.yaml import Mark, parse, plain

AT = Mark("here")
TEXT = """
model: {kind: a, dt: 1}
filters: [kf, {use: hkf, threshold: 2}, {use: hkf, threshold: [1, 3]}, {use: ukf, label: u1}]
readings:
  one: {model.dt: 2}
  two: {model: {kind: b, dt: 5}, filters.u1.kappa: 1}
sweep: {model.dt: [1, 2, 3], filters.hkf.threshold: [4, 5]}
"""


@pytest.fixture
def document():
    return parse(TEXT, "x")


def test_a_graft_replaces_a_node_and_leaves_the_old_data_alone(document) -> None:
    before = plain(document)
    new = graft(document, "model.dt", {"x": 1}, AT)
    assert new["model"] == {"kind": "a", "dt": {"x": 1}}
    assert locate(new, ("model", "dt", "x")) == AT
    assert plain(document) == before
    assert new["filters"] is document["filters"]


def test_none_removes_a_key_and_leaves_its_mark(document) -> None:
    new = graft(document, "model.dt", None, AT)
    assert new["model"] == {"kind": "a"}
    assert locate(new, ("model", "dt")) == AT


@pytest.mark.parametrize(("path", "index"), [("filters.kf.x", 0), ("filters.hkf.x", 1), ("filters.u1.x", 3)])
def test_entries_of_lists_are_addressed_by_label_or_name(document, path, index) -> None:
    new = graft(document, path, 7, AT)
    assert new["filters"][index]["x"] == 7
    assert [each for each in new["filters"] if isinstance(each, dict) and "x" in each] == [new["filters"][index]]


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("modle.dt", "did you mean 'model'"),
        ("model.dt.deep", "inside a single value"),
        ("model.body.cov", "there is no 'body'"),
        ("filters.ukf.x", "there is no entry 'ukf'"),
    ],
)
def test_a_path_that_leads_nowhere_is_an_error(document, path, message) -> None:
    with pytest.raises(SpecError, match=message):
        graft(document, path, 1, AT)


def test_setting_a_value_outranks_readings_and_makes_its_sweep_one_point(document) -> None:
    new = plain(set_value(document, "model.dt", 9, AT))
    assert new["model"]["dt"] == 9
    assert new["readings"] == {"one": {}, "two": {"model": {"kind": "b", "dt": 9}, "filters.u1.kappa": 1}}
    assert list(new["sweep"].items()) == [("model.dt", [9]), ("filters.hkf.threshold", [4, 5])]


def test_setting_a_whole_part_drops_the_sweeps_inside_it(document) -> None:
    new = plain(set_value(document, "model", {"kind": "c"}, AT))
    assert new["readings"] == {"one": {}, "two": {"filters.u1.kappa": 1}}
    assert list(new["sweep"]) == ["filters.hkf.threshold"]


def test_a_sweep_is_added_or_replaced_in_place(document) -> None:
    new = add_sweep(add_sweep(document, "model.dt", [7, 8], AT), "steps", [1, 2], AT)
    assert list(new["sweep"].items()) == [("model.dt", [7, 8]), ("filters.hkf.threshold", [4, 5]), ("steps", [1, 2])]
    assert add_sweep(parse("a: 1", "x"), "a", [1], AT)["sweep"] == {"a": [1]}
