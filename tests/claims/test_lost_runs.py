from __future__ import annotations

import numpy as np
import pytest

from rkfbench.claims.combinations import share_terms
from rkfbench.claims.ledger import Row
from rkfbench.claims.records import record, stored
from rkfbench.claims.verdict import Measured, interval
from rkfbench.claims.words import sentence
from tests.claims.fakes import Arrays, rows_of, verdict_of

M = 300
RNG = np.random.default_rng(11)
A, B = 5 + RNG.normal(size=M), 4 + RNG.normal(size=M)
FIRST = np.arange(M) < 3
ORDERING = {"ordering": {"metric": "e", "filters": ["a", "b"]}}


WILD = np.where(FIRST, 1e12, B)


def stats(a: np.ndarray = A, b: np.ndarray = B, lost_a: object = None, lost_b: object = None) -> Arrays:
    lost = {("", name): gone for name, gone in (("a", lost_a), ("b", lost_b)) if gone is not None}
    return Arrays({("", "a", "e"): a, ("", "b", "e"): b}, lost=lost)


def test_an_ordering_with_a_lost_run_is_decided_on_the_win_probability() -> None:
    (row,) = rows_of(ORDERING, stats(b=WILD, lost_b=FIRST))
    assert row.observed is not None
    assert row.observed.decided_on == "wins"
    assert row.observed.measured.estimate == pytest.approx(np.where(FIRST, False, A > B).mean())
    assert (row.observed.lost, row.observed.failed) == (3, 0)
    assert row.observed.mean < -1e9  # the mean is ruined, and shown
    assert row.observed.median == pytest.approx(np.median(A) - np.median(WILD))
    assert row.verdict == "reproduced"
    assert "win probability" in sentence(row)


def test_without_lost_runs_the_mean_decides() -> None:
    (row,) = rows_of(ORDERING, stats(b=WILD))
    assert row.observed is not None
    assert row.observed.decided_on == "estimate"
    assert row.verdict == "inconclusive"


def test_failed_runs_count_as_lost() -> None:
    (row,) = rows_of(ORDERING, stats(a=np.where(FIRST, np.nan, A)))
    assert row.observed is not None
    assert (row.observed.decided_on, row.observed.failed) == ("wins", 3)
    assert row.observed.measured.estimate == pytest.approx(np.where(FIRST, True, A > B).mean())


def test_a_run_lost_by_both_is_a_tie() -> None:
    (row,) = rows_of(ORDERING, stats(lost_a=FIRST, lost_b=FIRST))
    assert row.observed is not None
    assert row.observed.measured.ties == 3
    assert row.observed.measured.estimate == pytest.approx(np.where(FIRST, 0.5, A > B).mean())


def test_a_metric_where_large_is_good_can_say_so() -> None:
    claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "lost": "smallest"}}
    (row,) = rows_of(claim, stats(lost_a=FIRST))
    assert row.observed is not None
    assert row.observed.measured.estimate == pytest.approx(np.where(FIRST, False, A > B).mean())


def growth(lost: dict[tuple[str, str], object], text: str = "q=1 - q=0") -> Row:
    """The row of: from q=0 to q=1, a grows more than b; it does in 3 of 4 runs."""
    draws = np.random.default_rng(12)
    level = {("q=0", "a"): 5.0, ("q=0", "b"): 5.0, ("q=1", "a"): 9.0, ("q=1", "b"): 8.0}
    values = {(*key, "e"): at + 0.7 * draws.normal(size=M) for key, at in level.items()}
    claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "cases": text}}
    (row,) = rows_of(claim, Arrays(values, lost=lost))
    assert row.observed is not None
    return row


@pytest.mark.parametrize(
    ("lost", "counts"),
    [
        ([("q=1", "a")], 1.0),
        ([("q=1", "b")], 0.0),
        ([("q=0", "a")], 0.0),
        ([("q=0", "b")], 1.0),
        ([("q=1", "a"), ("q=0", "b")], 1.0),
        ([("q=1", "a"), ("q=1", "b")], 0.5),
        ([("q=1", "a"), ("q=0", "a")], 0.5),
    ],
)
def test_a_sum_of_several_is_decided_run_by_run_and_lost_values_decide_by_their_sign(
    lost: list[tuple[str, str]], counts: float
) -> None:
    sound, row = growth({}), growth(dict.fromkeys(lost, FIRST))
    assert sound.observed is not None
    assert row.observed is not None
    assert (sound.observed.decided_on, row.observed.decided_on) == ("estimate", "wins")
    values = np.random.default_rng(12).normal(size=(4, M)) * 0.7
    of_others = (4 - 3 + values[2] - values[0] - values[3] + values[1])[~FIRST] > 0
    assert row.observed.measured.estimate == pytest.approx((of_others.sum() + 3 * counts) / M)
    assert row.observed.measured.ties == (3 if counts == 0.5 else 0)


def test_an_ordering_of_quotients_with_lost_runs_is_inconclusive_and_says_why() -> None:
    assert growth({}, "q=1 / q=0").verdict == "reproduced"
    row = growth({("q=1", "b"): FIRST}, "q=1 / q=0")
    assert row.verdict == "inconclusive"
    assert "no two runs in order" in sentence(row)
    line = record(row)
    assert stored(line).observed == row.observed
    assert (line["decided_on"], line["reason"]) == ("nothing", row.judgement.reason)


def test_infinite_values_of_sound_runs_are_compared_and_not_left_out() -> None:
    never = np.arange(M) < 200
    (row,) = rows_of({"ordering": {"metric": "e", "filters": ["b", "a"]}}, stats(a=np.where(never, np.inf, A - 3)))
    assert row.observed is not None
    assert (row.observed.decided_on, row.observed.failed, row.observed.lost) == ("wins", 0, 0)
    assert row.observed.measured.estimate == pytest.approx((~never & (B > A - 3)).mean())
    assert row.verdict == "not reproduced"
    claim = {"bound": {"metric": "e", "filters": "a", "below": 9}}
    assert rows_of(claim, stats(a=np.where(never, np.inf, A)))[0].verdict == "inconclusive"  # there is no mean
    claim["bound"]["statistic"] = "median"
    assert rows_of(claim, stats(a=np.where(FIRST, np.inf, A)))[0].verdict == "reproduced"


class Undefined(Arrays):
    """Values that are NaN although no run failed."""

    def failed(self, reading: str, case: str, filter: str):
        return np.zeros(self.runs, bool)


def test_an_undefined_value_of_a_sound_run_is_left_out_also_of_medians_and_wins() -> None:
    gone = {("", "b"): FIRST}
    runs = Undefined({("", "a", "e"): np.where(np.arange(M) < 100, np.nan, A), ("", "b", "e"): B}, lost=gone)
    (row,) = rows_of({"bound": {"metric": "e", "filters": "a", "below": 9, "statistic": "median"}}, runs)
    assert row.observed is not None
    assert (row.observed.measured.estimate, row.observed.measured.runs) == (np.median(A[100:]), M - 100)
    (row,) = rows_of(ORDERING, runs)
    assert row.observed is not None
    assert row.observed.decided_on == "wins"
    assert (row.observed.measured.estimate, row.observed.measured.runs) == ((A > B)[100:].mean(), M - 100)


def test_the_spread_is_measured_on_all_runs_that_did_not_fail() -> None:
    claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "statistic": "sd"}}
    (row,) = rows_of(claim, stats(a=np.where(FIRST, np.nan, A), lost_b=FIRST))
    assert row.observed is not None
    assert (row.observed.decided_on, row.observed.measured.runs) == ("estimate", M - 3)
    assert row.observed.measured.estimate == pytest.approx(A[3:].std(ddof=1) / B[3:].std(ddof=1))


def test_other_claims_are_measured_on_the_runs_that_failed_nowhere() -> None:
    claim = {"ratio": {"metric": "e", "filters": ["a", "b"], "above": 1}}
    (row,) = rows_of(claim, stats(a=np.where(FIRST, np.nan, A)))
    assert row.observed is not None
    assert row.observed.measured.runs == M - 3
    assert row.observed.measured.estimate == pytest.approx(A[3:].mean() / B[3:].mean())


def test_failure_rates_are_compared_as_rare_events() -> None:
    claim = {"ordering": {"metric": "lost", "filters": ["a", "b"]}}
    assert verdict_of(claim, stats()) == "inconclusive"
    assert verdict_of(claim, stats(lost_a=FIRST)) == "inconclusive"
    assert verdict_of(claim, stats(lost_a=np.arange(M) < 12)) == "reproduced"
    assert verdict_of(claim, stats(lost_b=np.arange(M) < 12)) == "not reproduced"


def test_a_filter_that_fails_always_decides_by_wins_and_has_no_mean() -> None:
    dead = np.full(M, np.nan)
    assert verdict_of(ORDERING, stats(a=dead)) == "reproduced"
    assert verdict_of({"bound": {"metric": "e", "filters": "a", "below": 1}}, stats(a=dead)) == "inconclusive"


def test_a_median_counts_failed_runs_as_infinite() -> None:
    many = np.arange(M) < 100
    claim = {"bound": {"metric": "e", "filters": "a", "below": 9, "statistic": "median"}}
    (row,) = rows_of(claim, stats(a=np.where(many, np.nan, A)))
    assert row.observed is not None
    assert row.observed.measured.estimate == pytest.approx(np.median(np.where(many, np.inf, A)))
    assert row.verdict == "reproduced"
    assert verdict_of(claim, stats(a=np.where(np.arange(M) < 200, np.nan, A))) == "inconclusive"


def share_row(filters: str, region: dict[str, float], lost_a: object, lost_b: object):
    (row,) = rows_of({"bound": {"metric": "lost", "filters": filters, **region}}, stats(lost_a=lost_a, lost_b=lost_b))
    assert row.observed is not None
    return row, row.observed.measured


def test_a_difference_of_shares_looks_at_the_runs_in_which_the_filters_differ() -> None:
    gone_a, gone_b = np.arange(M) < 200, (np.arange(M) >= 3) & (np.arange(M) < 210)
    row, measured = share_row("a - b", {"above": -0.2, "below": 0.2}, gone_a, gone_b)
    assert measured.terms == ((-1.0, 10), (1.0, 3))
    assert measured.estimate == pytest.approx((3 - 10) / M)
    assert row.verdict == "reproduced"
    assert -0.1 < row.judgement.lower < measured.estimate < row.judgement.upper < 0.03


def test_a_sum_and_a_multiple_of_shares_have_their_terms() -> None:
    gone_a, gone_b = np.arange(M) < 30, np.arange(M) < 20
    assert share_row("a + b", {"below": 1}, gone_a, gone_b)[1].terms == ((1.0, 10), (2.0, 20))
    assert share_row("0.5 * a", {"below": 1}, gone_a, gone_b)[1].terms == ((0.5, 30),)
    assert share_row("0.5 * a - b", {"below": 1}, gone_a, gone_b)[1].terms == ((0.5, 30), (-1.0, 20))


def test_a_quotient_of_shares_is_no_sum() -> None:
    gone = np.arange(M) < 30
    assert share_row("a / b", {"below": 9}, gone, gone)[1].law == "t"


def test_no_lost_run_at_all_does_not_prove_equal_shares() -> None:
    none = np.zeros(M, bool)
    row, measured = share_row("a - b", {"above": -0.001, "below": 0.001}, none, none)
    assert (measured.estimate, measured.se, measured.law) == (0.0, 0.0, "shares")
    assert row.verdict == "inconclusive"


def test_the_interval_of_a_difference_of_shares_never_covers_less_than_promised() -> None:
    draws, runs, studies = np.random.default_rng(4), 60, 2000
    common = draws.random((studies, runs))
    flags = common < 0.15, (common < 0.1) | (draws.random((studies, runs)) < 0.02)
    truth, missed = 0.15 - (0.1 + 0.9 * 0.02), 0
    for a, b in zip(*flags, strict=True):
        terms = share_terms(np.array([1.0, -1.0]), np.array([a, b], float))
        low, high = interval(Measured((a.sum() - b.sum()) / runs, 0.0, runs, "shares", terms=terms), 0.025)
        missed += not low <= truth <= high
    assert missed <= 0.05 * studies


def test_a_stored_sum_of_shares_is_judged_as_one() -> None:
    row, measured = share_row("a - b", {"above": -0.2, "below": 0.2}, np.arange(M) < 12, FIRST)
    line = record(row)
    assert line["terms"] == "-1.0:0 1.0:9"
    kept = stored(line).observed
    assert kept is not None
    assert kept.measured == measured
