from __future__ import annotations

import math
from typing import get_args

import pytest

from rkfbench.claims.verdict import Verdict
from rkfbench.report import forest, style
from tests.report.fakes import claim_row

VERDICTS: tuple[Verdict, ...] = get_args(Verdict)[:-1]  # the last one, shown, decides nothing


def test_an_interval_inside_its_region_lies_inside_its_shade() -> None:
    line = forest.line([claim_row()])
    assert line.lower is not None
    assert line.upper is not None
    assert line.region[0] < line.lower < line.upper < line.region[1] == 1.0
    assert line.edges == ((line.region[0], "0"),)


def test_an_interval_across_an_edge_is_drawn_across_it() -> None:
    line = forest.line([claim_row(region_low=-0.05, region_high=0.05, estimate=0.03, se=0.01, lower=0.0, upper=0.06)])
    assert line.lower is not None
    assert line.upper is not None
    assert line.region[0] < line.lower < line.region[1] < line.upper


def test_a_printed_number_is_the_edge_of_a_replication_interval() -> None:
    line = forest.line([claim_row(printed=2.5, printed_runs=100, claimed=None, region_low=None, region_high=None)])
    assert line.claimed == "printed 2.5"
    assert [number for _, number in line.edges] == ["2.5"]
    assert line.region[0] == line.region[1]


@pytest.mark.parametrize("missing", [None, math.nan])
def test_what_was_not_measured_has_a_row_without_a_mark(missing: float | None) -> None:
    line = forest.line([claim_row(estimate=missing, se=missing, lower=missing, upper=missing, verdict="not run")])
    assert (line.at, line.estimate) == (None, "–")


def test_numbers_without_chance_are_shown_without_an_error() -> None:
    line = forest.line([claim_row(estimate=1e-12, se=0.0, law="exact", region_low=-math.inf, region_high=1e-9)])
    assert line.estimate == "1.000·10⁻¹²"


def test_a_claim_that_holds_is_shown_by_its_weakest_cell_one_that_fails_by_its_clearest() -> None:
    safe, near = claim_row(flip_percent=90.0), claim_row(flip_percent=2.0)
    open_ = claim_row(verdict="inconclusive", flip_percent=None)
    slightly, clearly = (claim_row(verdict="not reproduced", flip_percent=percent) for percent in (1.0, 40.0))
    assert forest.deciding([safe, near]) is near
    assert forest.deciding([safe, open_]) is open_
    assert forest.deciding([slightly, clearly, open_, near]) is clearly


def test_a_claim_that_may_hold_anywhere_is_shown_by_its_strongest_cell_and_with_its_own_verdict() -> None:
    weak, strong = claim_row(flip_percent=2.0), claim_row(flip_percent=90.0)
    near, far = (claim_row(verdict="not reproduced", flip_percent=percent) for percent in (1.0, 40.0))
    assert forest.deciding([near, weak, strong, far], "any") is strong
    assert forest.deciding([far, near], "any") is near
    (line,) = forest.lines([far, weak, strong], holds={"mine-1": "any"})
    assert (line.verdict, line.cells, line.row) == ("reproduced", 3, strong)
    assert line.among == "2 of 3 cells reproduced, 1 not, one is enough"


def test_lines_hold_what_decides_in_the_order_asked_for() -> None:
    rows = [claim_row(), claim_row(claim="b"), claim_row(claim="b", reading="root"), claim_row(role="beside")]
    assert [(line.claim, line.reading) for line in forest.lines(rows, ["b", "mine-1"], ["literal"])] == [
        ("b", "literal"),
        ("mine-1", "literal"),
    ]
    assert len(forest.lines(rows)) == 3


def test_every_verdict_can_be_drawn() -> None:
    rows = [claim_row(claim=verdict, verdict=verdict) for verdict in VERDICTS]
    rows.append(claim_row(claim="empty", estimate=None, lower=None, upper=None, region_low=None, region_high=None))
    with style.styled():
        assert style.png(forest.draw(forest.lines(rows), "A caption."), dpi=40)
