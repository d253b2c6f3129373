"""The files of the DAF and NRUKF papers: all claims of their notes, with grades of evidence, and their exact checks."""

from __future__ import annotations

import pytest

from rkfbench.claims.checks import checks_of
from rkfbench.claims.plan import faults
from rkfbench.scenario import load_paper
from rkfbench.scenario.claims import names_used
from tests.claims.fakes import offered

CLAIMS = {
    "daf": "C1 C2a C2b C3a C3b C3c C4a C4b C4c C5 C6 C7 C8a C8b E1 E2",
    "nrukf-2012": "C1 C2a C2b C3a C3b C3c C4 C5 C6 C7 C8 C9 C10 C11 C12 C13 C14",
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_paper_has_all_claims_of_its_note(name):
    paper = load_paper(name)
    prefix = name.partition("-")[0]
    assert [claim.id for claim in paper.claims] == [f"{prefix}-{each}" for each in CLAIMS[name].split()]
    assert all(claim.locator and claim.says for claim in paper.claims)


@pytest.mark.parametrize("name", CLAIMS)
def test_its_claims_fit_its_scenario_and_its_frozen_family(name):
    paper = load_paper(name)
    (scenario,) = paper.scenarios
    outline = offered(scenario, name)
    used = {use.name for claim in paper.claims for _, use in names_used(claim) if use.kind == "metric"}
    assert used <= {*outline.metrics, "lost", "failed"}
    assert [str(fault) for fault in faults(paper, {scenario: outline})] == []


@pytest.mark.parametrize("name", CLAIMS)
def test_margins_that_are_not_the_papers_say_so(name):
    for claim in load_paper(name).claims:
        bounds = [
            getattr(part.body, key, None)
            for _, role, part in claim.parts()
            if role == "decides"
            for key in ("above", "below", "margin")
        ]
        if any(bound not in (None, 0.0, 1.0) for bound in bounds):
            assert "ours" in claim.says or claim.evidence == "ours", claim.id


def test_what_is_reconstructed_or_ours_is_graded_so():
    grades = {claim.id: claim.evidence for name in CLAIMS for claim in load_paper(name).claims}
    assert {id for id, grade in grades.items() if grade == "ours"} == {"daf-E2", "nrukf-C12"}
    assert {id for id, grade in grades.items() if grade == "reconstruction"} == {"daf-C3c", "daf-E1", "nrukf-C5"}
    assert {id for id, grade in grades.items() if grade == "literature"} == {"nrukf-C14"}


@pytest.mark.parametrize(
    "check", ["daf.E1", "daf.E2", "nrukf.C7", "nrukf.C8-HUKF0", "nrukf.C8-NRUKF_R", "nrukf.C8-NRUKF_Y"]
)
def test_exact_statements_that_hold(check):
    outcome = {**checks_of("daf"), **checks_of("nrukf-2012")}[check]()
    assert outcome.holds, outcome


def test_huber_weights_on_all_rows_touch_the_prediction_too():
    outcome = checks_of("nrukf-2012")["nrukf.C6"]()
    assert outcome.deviation == pytest.approx(99.3275 - 5.38, abs=1e-4)  # at nu = 100, the vectors of the note
    assert not outcome.holds


@pytest.mark.parametrize("name", ["KF", "HUKF"])
def test_the_influence_of_a_measurement_grows_without_bound_where_state_rows_are_weighted_and_in_the_kalman_filter(
    name,
):
    assert not checks_of("nrukf-2012")[f"nrukf.C8-{name}"]().holds
