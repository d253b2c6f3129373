from dataclasses import dataclass
from typing import Annotated

import pytest

from rkfbench.catalogue import Entry
from rkfbench.errors import SpecError
from rkfbench.filters import FILTERS
from rkfbench.scenario.defaults import completed_filter
from rkfbench.scenario.filters import description, expanded
from rkfbench.scenario.yaml import parse, plain


@dataclass(frozen=True)
class Around:
    """A filter around another one."""

    filter: dict
    at: int
    lag: Annotated[int, "steps"] = 10
    points: tuple[int, ...] = (1, 2)


@pytest.fixture(autouse=True)
def _a_wrapper(monkeypatch) -> None:
    monkeypatch.setitem(FILTERS, "around", Entry(Around))


def listed(text: str) -> list[dict]:
    return plain(expanded(parse(f"filters: {text}", "x")["filters"]))


def test_a_name_is_its_own_label() -> None:
    assert listed("[kf]") == [{"use": "kf", "label": "kf"}]


def test_listed_values_make_one_filter_each_and_are_crossed() -> None:
    labels = [each["label"] for each in listed("[{use: hkf, threshold: [0.5, 2], root: [symmetric, cholesky]}]")]
    assert labels == [f"hkf[threshold={t},root={r}]" for t in ("0.5", "2") for r in ("symmetric", "cholesky")]


def test_values_are_listed_inside_parts_and_wrappers_too() -> None:
    inside = listed("[{weight: {huber: {threshold: [1, 2]}}, label: a}]")
    assert [each["weight"]["huber"]["threshold"] for each in inside] == [1, 2]
    assert [each["label"] for each in inside] == ["a[threshold=1]", "a[threshold=2]"]
    around = listed("[{around: {filter: {use: hkf, threshold: [1, 2]}, at: 5, lag: [3]}, label: b}]")
    assert [each["around"]["filter"]["threshold"] for each in around] == [1, 2]
    assert around[0]["around"]["lag"] == 3


def test_a_parameter_that_is_a_list_by_nature_is_left_alone() -> None:
    (each,) = listed("[{use: around, filter: {use: kf}, at: 5, points: [3, 4]}]")
    assert each["points"] == [3, 4]


@pytest.mark.parametrize(
    ("text", "path", "message"),
    [
        ("[kf, hkf, kf]", (2,), "two filters are labelled 'kf'"),
        ("[{weight: huber}]", (0,), "needs a label"),
        ("[3]", (0,), "a filter is a name or a mapping"),
        ("[{use: kf, label: 5}]", (0, "label"), "valid string"),
        ("[{use: kf, extra: 1}]", (0, "extra"), "valid boolean"),
        ("[{use: kf, assumed: {cow: 1}}]", (0, "assumed", "cow"), r"unknown key \(did you mean 'cov'"),
    ],
)
def test_faults_have_the_index_of_the_entry(text, path, message) -> None:
    with pytest.raises(SpecError, match=message) as error:
        listed(text)
    assert error.value.path == path


def test_all_entries_at_fault_are_told() -> None:
    with pytest.raises(SpecError) as error:
        listed("[3, kf, {weight: huber}]")
    assert [each.path for each in error.value] == [(0,), (2,)]


def test_defaults_are_written_out_in_every_form() -> None:
    hkf = {"threshold": 1.345, "root": "symmetric", "reuse_root": True}
    assert completed_filter("hkf") == {"use": "hkf", **hkf}
    assert completed_filter({"weight": "huber"})["weight"]["huber"]["threshold"] == 1.345
    assert completed_filter({"weight": {"huber": {"threshold": 2}}})["weight"]["huber"]["threshold"] == 2
    assert completed_filter({"around": {"filter": "hkf", "at": 5}, "label": "b"}) == {
        "around": {"lag": 10, "points": [1, 2], "filter": {"use": "hkf", **hkf}, "at": 5},
        "label": "b",
    }


def test_the_description_is_what_a_filter_is_built_from() -> None:
    (each,) = listed("[{use: hkf, threshold: 2, label: a, extra: true, assumed: {cov: 1}}]")
    assert description(each) == {"use": "hkf", "threshold": 2}


def test_lists_that_make_too_many_filters_are_refused_before_they_are_made(problems) -> None:
    values = str(list(range(1, 101)))
    many = f"{{use: ukf, alpha: {values}, beta: {values}, kappa: {values}}}"
    assert problems({"- kf\n": f"- {many}\n"}) == [
        "a.yaml:24:5: filters.ukf: there are more than 1000 filters with those that its lists make"
    ]


@pytest.mark.parametrize("inner", ["3", "[]", "~", "{use: [kf]}", "{use: {kf: 1}}"])
@pytest.mark.parametrize("around", ["fixed_point: {filter: INNER, at: 2, lag: 1}", "rts: {filter: INNER}"])
def test_a_filter_around_what_is_no_filter_is_told(problems, inner, around) -> None:
    (problem,) = problems({"- kf\n": f"- {{{around.replace('INNER', inner)}, label: a}}\n"})
    assert problem.startswith("a.yaml:24:")
    assert "filter" in problem


@pytest.mark.parametrize("alpha", ["1e308", "1e-320"])
def test_points_that_no_number_can_spread_are_refused(problems, alpha) -> None:
    (problem,) = problems({"- kf\n": f"- {{use: ukf, alpha: {alpha}}}\n"})
    assert "alpha^2 (n + kappa) must be a positive number" in problem


@pytest.mark.parametrize("dl", ["1e-320", "1e-8"])
def test_more_substeps_than_anybody_waits_for_are_refused(problems, dl) -> None:
    (problem,) = problems({"- kf\n": f"- {{use: pekf, dl: {dl}}}\n"})
    assert "1/dl must not be more than 10000 sub-steps" in problem
