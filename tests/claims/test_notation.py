"""What may be written as a claim, and how faults are told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from rkfbench.claims.estimand import Estimand, Point
from rkfbench.claims.expression import parse
from rkfbench.claims.plan import Outline, family_problems, family_sizes, faults, plan, problems
from rkfbench.errors import SpecError
from rkfbench.scenario.claims import KINDS, Claim, Part, names_used
from rkfbench.scenario.paper_schema import Paper
from rkfbench.times import FORMS
from tests.claims.fakes import offered

OUTLINE = Outline(("literal", "root"), ("R1", "R2"), ("ekf", "ukf", "pekf"), ("rmse", "mse"), ("p.T1",))
BASE: dict[str, Any] = {"metric": "rmse", "filters": ["ekf", "pekf"], "cases": ["R1"]}


def claim(**parts: Any) -> Claim:
    return Claim.model_validate({"id": "c", "says": "x", **parts})


def paper(*claims: dict[str, Any], **more: Any) -> Paper:
    listed = [{"id": f"c{i}", "says": "x", **each} for i, each in enumerate(claims)]
    return Paper.model_validate({"cite": "x", "scenarios": ["s"], "claims": listed, **more})


def faults_of(*claims: dict[str, Any], **more: Any) -> list[str]:
    return [str(error) for error in faults(paper(*claims, **more), {"s": OUTLINE})]


@pytest.mark.parametrize(
    ("parts", "place", "message"),
    [
        ({}, (), "exactly one of"),
        ({"ordering": BASE, "best": BASE}, (), "has ordering, best"),
        ({"ordering": BASE | {"margn": 1}}, ("ordering", "margn"), "Extra inputs"),
        ({"ordering": BASE | {"filters": []}}, ("ordering", "filters"), "a name or a list"),
        ({"ordering": BASE | {"filters": ["ekf", 3]}}, ("ordering", "filters"), "not 3"),
        ({"ordering": BASE | {"filters": ["ekf - ", "ukf"]}}, ("ordering", "filters"), "missing at the end"),
        ({"equal": BASE}, ("equal", "margin"), "Field required"),
        ({"equal": BASE | {"margin": "5 %"}}, ("equal", "margin"), "valid number"),
        ({"bound": BASE}, ("bound",), "`above`, `below` or both"),
        ({"bound": BASE | {"above": 2, "below": 1}}, ("bound",), "smaller"),
        ({"show": BASE}, (), "beside"),
        ({"unsupported": {"reason": ""}}, ("unsupported", "reason"), "at least 1"),
        ({"ordering": BASE, "evidence": "hearsay"}, ("evidence",), "Input should be"),
        ({"ordering": BASE, "also": [{"ordering": {"metric": "rmse"}}]}, ("also", 0, "ordering", "filters"), "requi"),
    ],
)
def test_a_fault_is_told_where_it_stands(parts: dict, place: tuple, message: str) -> None:
    with pytest.raises(ValidationError) as caught:
        claim(**parts)
    assert any(tuple(e["loc"]) == place and message in e["msg"] for e in caught.value.errors()), caught.value.errors()


def test_every_kind_is_a_field_with_a_description() -> None:
    assert set(KINDS) == set(Part.model_fields)
    for model in (Part, Claim, Paper):
        assert all(field.description for field in model.model_fields.values()), model


def test_the_names_that_a_claim_uses_come_with_their_place() -> None:
    uses = list(names_used(claim(ordering=BASE | {"filters": ["ekf", ["ukf", "pekf / ekf"]], "readings": ["root"]})))
    assert [(use.kind, use.name, use.path) for _, use in uses] == [
        ("reading", "root", ("ordering", "readings", 0)),
        ("metric", "rmse", ("ordering", "metric")),
        ("filter", "ekf", ("ordering", "filters", 0)),
        ("filter", "ukf", ("ordering", "filters", 1)),
        ("filter", "pekf", ("ordering", "filters", 1)),
        ("filter", "ekf", ("ordering", "filters", 1)),
        ("case", "R1", ("ordering", "cases")),
    ]


@pytest.mark.parametrize(
    ("part", "message"),
    [
        ({"ordering": BASE | {"metric": "rmsee"}}, "0.ordering.metric: unknown metric 'rmsee' (did you mean 'rmse'"),
        ({"ordering": BASE | {"filters": ["ekf", "pekg"]}}, "0.ordering.filters.1: unknown filter 'pekg' (did you"),
        ({"ordering": BASE | {"cases": ["R1", "R3"]}}, "claims.0.ordering.cases.1: unknown case 'R3'"),
        ({"ordering": BASE | {"readings": ["rot"]}}, "0.ordering.readings.0: unknown reading 'rot' (did you mean"),
        ({"ordering": {**BASE, "cases": ""}}, "claims.0.ordering: `cases` is missing; the scenario has R1, R2"),
        ({"ordering": BASE | {"filters": "ekf"}}, "claims.0.ordering.filters: needs at least two to compare"),
        ({"ordering": BASE | {"scenario": "t"}}, "claims.0.ordering.scenario: unknown scenario 't'"),
        ({"share": BASE | {"filters": ["ekf - ukf", "ekf"]}}, "0.share.filters.0: shares of runs compare single"),
        ({"shape": BASE | {"along": "filters", "steps": ["up", "up"]}}, "2 items have 1 steps, not 2"),
        ({"exact": {"check": "p.T2"}}, "claims.0.exact.check: unknown check 'p.T2' (did you mean 'p.T1'?)"),
        ({"value": {"table": "t"}}, "claims.0.value.table: unknown table 't'"),
        ({"ordering": BASE | {"metric": "time_foo"}}, "claims.0.ordering.metric: unknown metric 'time_foo'"),
        (
            {"slope": {**BASE, "filters": "ekf", "cases": ["R=e", "R=1"], "above": 0}},
            "claims.0.slope.points: the labels do not hold one number each",
        ),
    ],
)
def test_a_claim_that_cannot_be_measured_is_a_fault_of_the_file(part: dict, message: str) -> None:
    found = faults_of(part)
    assert any(message in each for each in found), found


def test_a_check_is_unknown_to_a_scenario_that_has_none() -> None:
    outlines = {"s": replace(OUTLINE, checks=())}
    (fault,) = problems(paper({"exact": {"check": "p.T1"}}), outlines)
    assert str(fault) == "claims.0.exact.check: unknown check 'p.T1'"


@pytest.mark.parametrize("name", FORMS)
def test_measured_times_are_the_only_metrics_of_timings(name: str) -> None:
    timed, other = (
        Estimand("value", (Point(parse(each), parse("ekf"), parse("R1")),)) for each in (name, f"{name}_else")
    )
    assert timed.timing
    assert not other.timing


def test_all_faults_of_all_claims_are_told_at_once() -> None:
    wrong = paper({"ordering": BASE | {"metric": "x", "filters": ["y", "z"]}}, {"exact": {"check": "w"}})
    with pytest.raises(SpecError) as caught:
        plan(wrong, {"s": OUTLINE})
    assert len(list(caught.value)) == 4


def test_claims_may_name_filters_that_are_only_timed() -> None:
    assert "hkf_cholesky" in offered("contamination-rates", "aladkf-2020").filters


def test_a_named_group_is_written_out_alone_as_the_list_and_within_a_list_as_a_group() -> None:
    groups = {"all": ["ekf", "ukf", "pekf"], "both": ["ekf", "ukf"], "R": ["R1", "R2"]}
    alone, within = (
        plan(paper({"ordering": BASE | {"filters": names}}, groups=groups), {"s": OUTLINE})
        for names in ("all", ["both", "pekf"])
    )
    assert [cell.form.text for cell in alone if cell.reading == "root"] == [
        "ekf - ukf in rmse at R1",
        "ukf - pekf in rmse at R1",
    ]
    assert [cell.form.text for cell in within if cell.reading == "root"] == [
        "ekf - pekf in rmse at R1",
        "ukf - pekf in rmse at R1",
    ]
    crossed = plan(paper({"ordering": BASE | {"cases": "R"}}, groups=groups), {"s": OUTLINE})
    assert [cell.form.text[-2:] for cell in crossed if cell.reading == "root"] == ["R1", "R2"]


TABLE = {
    "title": "Table 1",
    "runs": 100,
    "decimals": 2,
    "metric": "rmse",
    "columns": [{"label": "R1 mean", "case": "R1"}, {"label": "R1 sd", "case": "R1", "statistic": "sd"}],
    "rows": [
        {"label": "EKF", "filter": "ekf", "values": [43.8, 3.1]},
        {"label": "PEKF", "filter": "pekf", "values": [41.2, None]},
    ],
}


def test_a_templated_id_makes_one_claim_a_printed_cell() -> None:
    one = paper({"id": "t1-{row}-{column}", "value": {"table": "t"}}, tables={"t": TABLE})
    cells = [cell for cell in plan(one, {"s": OUTLINE}) if cell.reading == "literal"]
    assert [cell.id for cell in cells] == ["t1-ekf-r1-mean", "t1-ekf-r1-sd", "t1-pekf-r1-mean"]
    assert [cell.form.text for cell in cells][1] == "ekf in sd of rmse at R1"
    assert cells[0].form.printed is not None
    assert (cells[0].form.printed.value, cells[0].form.printed.rounding) == (43.8, 0.005)


def test_a_printed_table_must_say_what_its_cells_are() -> None:
    bare = {**TABLE, "metric": None}
    assert "neither says which metric" in faults_of({"value": {"table": "t"}}, tables={"t": bare})[0]
    wrong = {**TABLE, "metric": "rmsee"}
    assert "unknown metric 'rmsee'" in faults_of({"value": {"table": "t"}}, tables={"t": wrong})[0]
    assert "unknown row 'UKF'" in faults_of({"value": {"table": "t", "rows": ["UKF"]}}, tables={"t": TABLE})[0]
    with pytest.raises(ValidationError, match="has 1 values for 2 columns"):
        paper(tables={"t": {**TABLE, "rows": [{"label": "EKF", "filter": "ekf", "values": [1.0]}]}})


def test_a_family_counts_deciding_stochastic_cells_and_nothing_else() -> None:
    mixed = paper(
        {"ordering": BASE | {"filters": ["ekf", "ukf", "pekf"]}, "beside": [{"show": BASE}]},
        {"ordering": BASE | {"readings": ["root"]}},
        {"ordering": BASE | {"metric": "time_ms"}},
        {"ordering": BASE, "extra": True},
        {"exact": {"check": "p.T1"}},
        {"unsupported": {"reason": "nothing"}},
    )
    cells = plan(mixed, {"s": OUTLINE})
    assert family_sizes(mixed, cells, {"s": OUTLINE}) == {"literal": 2, "root": 3}
    assert family_sizes(mixed, cells, {"s": OUTLINE}, "timing") == {"literal": 1, "root": 1}


def test_a_scenario_without_a_reading_counts_with_its_first_one() -> None:
    two = Paper.model_validate(
        {
            "cite": "x",
            "scenarios": ["s", "t"],
            "claims": [
                {"id": "a", "says": "x", "ordering": BASE},
                {"id": "b", "says": "x", "ordering": BASE | {"scenario": "t", "filters": ["ekf", "ukf", "pekf"]}},
            ],
        }
    )
    outlines = {"s": OUTLINE, "t": Outline(("default",), ("R1",), OUTLINE.filters, OUTLINE.metrics)}
    cells = plan(two, outlines)
    assert family_sizes(two, cells, outlines) == {"literal": 3, "root": 3, "default": 3}


def test_a_frozen_family_that_does_not_fit_is_told_with_the_right_number() -> None:
    wrong = paper({"ordering": BASE}, family={"literal": 63, "rot": 1})
    found = [str(each) for each in family_problems(wrong, plan(wrong, {"s": OUTLINE}), {"s": OUTLINE})]
    assert found == [
        "family.literal: the claims have 1 cells, not 63",
        "family: reading 'root' is missing; its claims have 1 cells",
        "family.rot: unknown reading 'rot' (did you mean 'root'?)",
    ]


def test_the_headline_names_claims_that_exist() -> None:
    with pytest.raises(ValidationError, match="no claim 'zz'"):
        paper({"ordering": BASE}, headline=["zz"])
    with pytest.raises(ValidationError, match="stands twice"):
        paper({"id": "a", "ordering": BASE}, {"id": "a", "ordering": BASE})
