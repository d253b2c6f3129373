"""Claims of a scenario's own: what is wrong with them is told when the file is read, where it stands."""

from __future__ import annotations

import pytest

FIGURES = "figures:\n"
FIRST = 29  # line of the first claim


def claims(*kinds: str) -> dict[str, str]:
    """A replacement that puts claims before the figures, one a line: a measurement after its id, or a whole entry."""
    lines = (f"  - {{id: c{i}, says: x, {kind}}}\n" for i, kind in enumerate(kinds))
    return {FIGURES: f"claims:\n{''.join(lines)}{FIGURES}"}


RATES = "metric: rmse, filters: kf, cases: ['near,rate=0', 'near,rate=0.2']"


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("ordering: {metric: err_norm@k, filters: [kf, hkf], cases: 'near,rate=0'}", "unknown metric 'err_norm@k'"),
        ("ordering: {metric: rms, filters: [kf, hkf], cases: 'near,rate=0'}", "unknown metric 'rms' (did you mean"),
        ("ordering: {metric: time_foo, filters: [kf, hkf], cases: 'near,rate=0'}", "unknown metric 'time_foo'"),
        ("ordering: {metric: rmse, filters: [kf, hkf], cases: near}", "unknown case 'near'"),
        ("ordering: {metric: rmse, filters: [kf, hkg], cases: 'near,rate=0'}", "filters.1: unknown filter 'hkg'"),
        ("ordering: {metric: rmse, filters: kf, cases: 'near,rate=0'}", "filters: needs at least two to compare"),
        ("ordering: {metric: rmse, filters: [kf, hkf]}", "`cases` is missing; the scenario has near,rate=0, "),
        (f"trend: {{{RATES}, readings: [plain+wide start]}}", "readings.0: unknown reading 'plain+wide start'"),
        (f"trend: {{{RATES}, scenario: nope}}", "scenario: unknown scenario 'nope'"),
        (f"shape: {{{RATES}, steps: [up, down]}}", "shape.steps: 2 items have 1 steps, not 2"),
        (f"eigenvalue: {{{RATES}, along: cases, above: 0}}", "cases: 2 entries are no lower triangle of a matrix"),
        (f"slope: {{{RATES}, along: filters, above: 0}}", "slope.filters: needs at least two to compare"),
        (
            "slope: {metric: rmse, filters: [kf, hkf], cases: 'near,rate=0', along: filters, above: 0}",
            "slope.points: the labels do not hold one number each",
        ),
        (
            "share: {metric: rmse, filters: [kf - hkf, hkf], cases: 'near,rate=0'}",
            "share.filters.0: shares of runs compare single values",
        ),
        ("value: {table: foo}", "claims.c0.value.table: unknown table 'foo'"),
        ("exact: {check: foo}", "claims.c0.exact.check: unknown check 'foo'"),
    ],
)
def test_a_claim_that_cannot_be_judged_is_told_once_and_where_it_stands(problems, kind, message) -> None:
    (found,) = problems(claims(kind))
    assert found.startswith(f"a.yaml:{FIRST}:")
    assert message in found


def test_all_faults_of_claims_are_told_together_with_those_of_figures(problems) -> None:
    texts = claims("value: {table: foo}", f"shape: {{{RATES}, steps: [up, down]}}") | {"over: rate": "over: rates"}
    assert [each.split(": ")[0] for each in problems(texts)] == ["a.yaml:29:38", "a.yaml:30:106", "a.yaml:32:36"]


def test_an_id_that_stands_twice_is_told_once(problems) -> None:
    (found,) = problems({FIGURES: claims(*[f"trend: {{{RATES}}}"] * 2)[FIGURES].replace("c1", "c0")})
    assert found == "a.yaml:30:10: claims.c0.id: the id 'c0' is used twice"


def test_claims_on_what_options_have_removed_are_left_out_and_other_faults_told(change, problems) -> None:
    good, gone = f"trend: {{{RATES}}}", "bound: {metric: rmse, filters: kf, cases: 'far,rate=0', above: 0}"
    options = {"sets": ["measurement_noise.rate=0.2"]}
    assert change(claims(good, gone), **options).claims == ()
    assert len(change(claims(good, gone)).claims) == 2
    (found,) = problems(claims(good, "value: {table: foo}"), **options)
    assert found.startswith("a.yaml:30:")


def test_claims_may_ask_for_the_checks_of_the_paper_that_the_scenario_names(change, problems) -> None:
    paper = {"name: small": "name: small\npaper: aladkf-2020"}
    assert change(claims("exact: {check: aladkf.T1}") | paper).claims
    (found,) = problems(claims("exact: {check: aladkf.T0}") | paper)
    assert "unknown check 'aladkf.T0' (did you mean 'aladkf.T" in found


def test_times_are_the_only_metrics_that_need_not_be_listed(change, problems) -> None:
    times = ("bound: {metric: time_ms, filters: kf, cases: 'near,rate=0', below: 1}", "tables: [{id: t, metric: ")
    assert change(claims(times[0]) | {"name: small": f"name: small\n{times[1]}time_ms}}]"}).claims
    (found,) = problems({"name: small": f"name: small\n{times[1]}timeline}}]"})
    assert "a.yaml:2:" in found
    assert "tables.t.metric: no metric 'timeline' here" in found
