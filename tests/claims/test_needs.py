from __future__ import annotations

import pytest

from rkfbench.claims.needs import only_full, why_not_run
from rkfbench.claims.plan import Cell
from rkfbench.judge import dockets
from rkfbench.scenario import load, load_bundled


def cells(scenario: str, claim: str) -> list[Cell]:
    """The cells of a claim of the scenario's paper that the scenario decides."""
    (docket,) = dockets(load_bundled(scenario))
    return [cell for cell in docket.cells if cell.id == claim and cell.form.scenario == scenario]


@pytest.mark.parametrize(
    ("scenario", "claim", "full"),
    [
        ("navigation", "fpmcs-C34", True),  # chosen on tuning runs
        ("navigation", "fpmcs-C34-particles", True),  # extra filters
        ("contamination-rates", "aladkf-C3d", False),
        ("contamination-rates", "aladkf-H5", False),  # an exact check
    ],
)
def test_what_needs_extras_is_known_before_anything_is_run(scenario: str, claim: str, full: bool) -> None:
    found = cells(scenario, claim)
    assert {only_full(cell, load_bundled(scenario)) for cell in found if cell.role == "decides"} == {full}
    expected = "needs extras: run with --full" if full else "not measured yet: run again"
    assert {why_not_run(cell, load_bundled(scenario)) for cell in found if cell.role == "decides"} == {expected}


@pytest.mark.parametrize(
    ("options", "lacking"),
    [
        ({"sets": ["measurement_noise.rate=0.1"]}, "case rate=0.3"),
        ({"sweeps": ["filters.hkf.threshold=0.5,3"]}, "case rate=0.3"),
        ({"sets": ["metrics=[cond_S]"]}, "metric err_norm"),
    ],
)
def test_options_that_took_away_what_a_claim_is_about_are_the_reason(
    options: dict[str, list[str]], lacking: str
) -> None:
    changed = load("contamination-rates", **options)  # type: ignore[arg-type]
    cell = cells("contamination-rates", "aladkf-C3d")[0]
    assert why_not_run(cell, changed) == f"options or an edit changed the experiment: it has no {lacking}"
