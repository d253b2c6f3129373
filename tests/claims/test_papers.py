"""The papers' files as they are bundled."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rkfbench.claims.plan import faults, plan
from rkfbench.errors import ScenarioError
from rkfbench.scenario import load_paper
from rkfbench.scenario.claims import names_used
from tests.claims.fakes import offered

ALADKF = {
    *("C0", "C1a", "C1b", "C1c", "C1d", "T1", "T2", "T3", "T4", "T5", "H1", "H2", "H3", "H4", "H5", "H6", "L1", "A1"),
    *(
        "C2a",
        "C2b",
        "C2c",
        "C2d",
        "C3a",
        "C3b",
        "C3c",
        "C3d",
        "C3e",
        "C3f",
        "C3g",
        "C3h",
        "C3i",
        "C4a",
        "C4b",
        "C4c",
        "C5",
    ),
}


def test_the_aladkf_paper_has_all_claims_of_its_note_and_one_that_it_lacks() -> None:
    paper = load_paper("aladkf-2020")
    assert {claim.id for claim in paper.claims} == {f"aladkf-{name}" for name in ALADKF}
    assert 1 <= len(paper.headline) <= 6
    assert all(claim.locator and claim.says for claim in paper.claims)


def test_thresholds_that_the_paper_does_not_give_say_that_they_are_ours() -> None:
    chance = {"aladkf-C5": 0.5}  # the AUC of guessing is no choice of ours
    for claim in load_paper("aladkf-2020").claims:
        bounds = [getattr(claim.body, name, None) for name in ("above", "below", "margin")]
        if any(bound not in (None, 0.0, chance.get(claim.id)) for bound in bounds):
            assert "ours" in claim.says, claim.id


def test_its_claims_fit_the_scenario_and_its_frozen_family() -> None:
    paper = load_paper("aladkf-2020")
    outline = offered("contamination-rates", "aladkf-2020")
    used = {use.name for claim in paper.claims for _, use in names_used(claim) if use.kind == "metric"}
    known = {"contamination-rates": replace(outline, metrics=(*outline.metrics, *used))}
    assert [str(fault) for fault in faults(paper, known)] == []
    assert plan(paper, known)


def test_the_paired_differences_of_the_note_have_their_share_of_runs_beside_them() -> None:
    parts = (part.body for claim in load_paper("aladkf-2020").claims for part in claim.beside if part.kind == "share")
    found = {part.metric[0][0]: (part.filters, part.cases) for part in parts}
    expected = ((("aladkf",), ("hkf",)), (("rate=0",), ("cases-1-4",)))  # HKF - ALADKF > 0
    assert found == dict.fromkeys(("err_norm", "cond_S", "if_norm"), expected)


def test_a_wrong_name_is_told_with_its_line() -> None:
    outline = offered("contamination-rates", "aladkf-2020")
    without = {"contamination-rates": replace(outline, filters=("kf", "hkf"))}
    with pytest.raises(ScenarioError, match=r"aladkf-2020.yaml:\d+:\d+: .*unknown filter 'aladkf'") as caught:
        load_paper("aladkf-2020", lambda paper: faults(paper, without))
    problem = next(each for each in caught.value.problems if "unknown filter 'aladkf'" in each.message)
    assert "aladkf" in problem.source[problem.column - 1 :]
