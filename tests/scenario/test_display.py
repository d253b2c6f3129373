from __future__ import annotations

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from rkfbench.scenario.display import Figure, NameUse, Table, case_matches, names_used

FIGURES: TypeAdapter[Any] = TypeAdapter(Figure)


@pytest.mark.parametrize(
    "figure",
    [
        {"kind": "curve", "metric": "rmse@k", "beside": "bound@k", "statistic": "median", "x": {"log": True}},
        {"kind": "panels", "metric": "error@k", "band": "rmse@k", "share": "row"},
        {"kind": "curve", "metric": ["mse[px]@lag", "mse[py]@lag"], "before": ["mse_prior[px]@j", "mse_prior[py]@j"]},
        {"kind": "sweep", "over": "rate", "metric": ["rmse", "cond_S"], "whiskers": "sd"},
        {"kind": "runs", "metric": "rmse", "first": 50},
        {"kind": "bars", "metric": "rmse", "paper": "table1"},
        {"kind": "influence", "filters": ["kf", "hkf"], "prior": 4.0, "largest": 20.0},
        {"kind": "forest", "claims": ["C1"]},
    ],
    ids=lambda figure: figure["kind"],
)
def test_every_kind_can_be_declared(figure: dict[str, Any]) -> None:
    assert FIGURES.validate_python({"id": "fig1", **figure}).kind == figure["kind"]


@pytest.mark.parametrize(
    ("figure", "place"),
    [
        ({"id": "f", "kind": "curves", "metric": "rmse"}, ()),
        ({"id": "f", "kind": "curve"}, ("curve", "metric")),
        ({"id": "a b", "kind": "curve", "metric": "rmse"}, ("curve", "id")),
        ({"id": "f", "kind": "curve", "metric": "rmse", "colour": "red"}, ("curve", "colour")),
        ({"id": "f", "kind": "runs", "metric": "rmse", "first": 0}, ("runs", "first")),
        ({"id": "f", "kind": "runs", "metric": "rmse", "first": True}, ("runs", "first")),
        ({"id": "f", "kind": "curve", "metric": "rmse", "x": {"limits": [0]}}, ("curve", "x", "limits")),
        ({"id": "f", "kind": "sweep", "metric": "rmse"}, ("sweep", "over")),
        ({"id": "f", "kind": "curve", "metric": ["a@lag", "b@lag"], "before": "a@j"}, ("curve",)),
        ({"id": "f", "kind": "curve", "metric": "a@k", "before": "a", "statistic": "first"}, ("curve",)),
    ],
)
def test_what_makes_no_sense_is_refused_where_it_stands(figure: dict[str, Any], place: tuple[str, ...]) -> None:
    with pytest.raises(ValidationError) as caught:
        FIGURES.validate_python(figure)
    assert caught.value.errors()[0]["loc"] == place


def test_a_table_says_what_it_shows_or_takes_it_from_a_printed_one() -> None:
    assert Table(id="t", paper="table1").metrics == []
    with pytest.raises(ValidationError, match="needs `metric`, or `paper`"):
        Table(id="t")
    with pytest.raises(ValidationError, match="go with `metric`"):
        Table(id="t", paper="table1", rows="filter")


def test_a_table_that_is_computed_shows_no_results() -> None:
    assert Table(id="t", computed="operation_counts", title="Table 1", caption="Exact.").metrics == []
    with pytest.raises(ValidationError, match="`metric` does not go with `computed`"):
        Table(id="t", computed="operation_counts", metric="rmse")
    with pytest.raises(ValidationError, match="`readings` does not go with `computed`"):
        Table(id="t", computed="operation_counts", readings=["a"])


def test_every_name_is_told_with_its_place() -> None:
    figure = {"id": "f", "kind": "bars", "metric": ["a", "b"], "filters": ["kf"], "cases": ["R2"], "paper": "table1"}
    assert list(names_used(FIGURES.validate_python(figure))) == [
        NameUse("metric", "a", ("metric", 0)),
        NameUse("metric", "b", ("metric", 1)),
        NameUse("filter", "kf", ("filters", 0)),
        NameUse("case", "R2", ("cases", 0)),
        NameUse("printed", "table1", ("paper",)),
    ]


def test_a_table_uses_every_metric_of_its_arithmetic_and_a_figure_takes_none() -> None:
    written = "100 * (mse_prior@j - mse@j) / mse_prior@j"
    table = Table(id="t", metric=["mse@j", written, "share(name=w, limit=0.5)"])
    assert list(names_used(table)) == [
        NameUse("metric", "mse@j", ("metric", 0)),
        NameUse("metric", "mse_prior@j", ("metric", 1)),
        NameUse("metric", "mse@j", ("metric", 1)),
        NameUse("metric", "share(name=w, limit=0.5)", ("metric", 2)),
    ]
    figure = FIGURES.validate_python({"id": "f", "kind": "bars", "metric": written})
    assert list(names_used(figure)) == [NameUse("metric", written, ("metric",))]


@pytest.mark.parametrize(
    ("name", "label", "picked"),
    [
        ("R2", "R2", True),
        ("R2", "R2,rate=0.2", True),
        ("rate=0.2", "R2,rate=0.2", True),
        ("R2,rate=0.2", "R2,rate=0.2", True),
        ("R2,rate=0.2", "R2", False),
        ("rate=0.2", "rate=0.25", False),
        ("", "", True),
    ],
)
def test_a_case_is_named_by_its_label_or_a_part_of_it(name: str, label: str, picked: bool) -> None:
    assert case_matches(name, label) is picked
