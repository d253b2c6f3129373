from __future__ import annotations

from math import inf, isnan, nan

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.proportion import proportion_confint

from rkfbench.claims.verdict import Measured, Printed, Region, combine, critical, interval, judge

POSITIVE = Region(0.0, inf, open=True)
WINS = Region(0.5, inf, open=True)


def test_the_critical_value_is_the_bonferroni_quantile_of_students_t() -> None:
    assert critical(0.025 / 63, 100) == pytest.approx(stats.t.ppf(1 - 0.025 / 63, 99), rel=1e-10)


def test_a_family_decides_like_bonferroni_adjusted_p_values() -> None:
    draws = np.random.default_rng(1).normal(0.3, 1, size=(40, 80))
    ours = [judge(Measured(x.mean(), stats.sem(x), 80), POSITIVE, 40).verdict == "reproduced" for x in draws]
    p = stats.ttest_1samp(draws, 0, axis=1).pvalue
    theirs = multipletests(p, 0.05, "bonferroni")[0] & (draws.mean(axis=1) > 0)
    assert ours == list(theirs)
    assert 0 < sum(ours) < 40


@pytest.mark.parametrize("wins", [0, 1, 13, 50, 99, 100])
def test_the_interval_of_a_share_is_that_of_clopper_and_pearson(wins: int) -> None:
    ours = interval(Measured(wins / 100, nan, 100, "share"), 0.025)
    assert ours == pytest.approx(proportion_confint(wins, 100, 0.05, "beta"), abs=1e-12)


def test_ties_pull_a_share_towards_one_half_and_decide_like_the_sign_test() -> None:
    low, _ = interval(Measured((12 + 88 / 2) / 100, nan, 100, "share", ties=88), 0.025, WINS)
    assert stats.binomtest(12, 12).pvalue < 0.025
    assert low > 0.5
    low, _ = interval(Measured((4 + 96 / 2) / 100, nan, 100, "share", ties=96), 0.025, WINS)
    assert stats.binomtest(4, 4).pvalue > 0.05
    assert low < 0.5


def test_runs_that_all_tie_leave_room_for_what_was_not_seen() -> None:
    for region in (WINS, Region(0.4)):
        low, high = interval(Measured(0.5, 0.0, 100, "share", ties=100), 0.025, region)
        assert 0.45 < low < 0.5 < high < 0.55


def test_a_share_with_ties_is_a_sum_of_shares_against_another_edge_than_one_half() -> None:
    measured = Measured((40 + 50 / 2) / 100, nan, 100, "share", ties=50)
    as_sum = Measured(0.15, nan, 100, "shares", terms=((0.5, 40), (-0.5, 10)))
    judgement = judge(measured, Region(0.6))
    assert (judgement.lower - 0.5, judgement.upper - 0.5) == pytest.approx(interval(as_sum, 0.025))
    assert judgement.lower < judge(measured, Region(0.5)).lower


def test_the_interval_of_a_spread_is_one_of_its_logarithm() -> None:
    measured = Measured(2.0, 0.3, 50, "log")
    half = stats.t.ppf(0.975, 49) * 0.15
    assert interval(measured, 0.025) == pytest.approx((2 * np.exp(-half), 2 * np.exp(half)))
    for value, sign in ((2.5, 1), (1.5, -1)):
        replicated = judge(measured, Region(), printed=Printed(value, 50))
        end = replicated.upper if sign > 0 else replicated.lower
        assert end == pytest.approx(2 * np.exp(sign * half * np.sqrt(2)))
    assert interval(Measured(2.0, 0.0, 50, "log"), 0.025) == (2.0, 2.0)


def test_a_sum_of_shares_adds_the_ends_of_clopper_and_pearson_at_a_part_of_the_tail() -> None:
    measured = Measured((7 - 3) / 100, nan, 100, "shares", terms=((-1.0, 3), (1.0, 7)))
    (low_7, high_7), (low_3, high_3) = (proportion_confint(n, 100, 0.025, "beta") for n in (7, 3))
    assert interval(measured, 0.025) == pytest.approx((low_7 - high_3, high_7 - low_3), abs=1e-12)


def test_runs_without_any_difference_decide_only_what_they_are_enough_for() -> None:
    """No run lost by one filter alone: of 1000 runs that bounds the difference by 1.1 %, of 100 runs by 10 %."""
    within = Region(-0.02, 0.02)
    none = Measured(0.0, 0.0, 1000, "shares", terms=((-1.0, 0), (1.0, 0)))
    assert judge(none, within, 590).verdict == "reproduced"
    few = none.at(100)
    judgement = judge(few, within, 590)
    assert judgement.verdict == "inconclusive"
    assert judgement.runs_needed is not None
    assert 100 < judgement.runs_needed < 1000
    assert judge(none, Region(high=0.0), 1).verdict == "inconclusive"  # nothing proves that there is none at all


@pytest.mark.parametrize(
    ("estimate", "region", "verdict"),
    [
        (3.0, POSITIVE, "reproduced"),
        (-3.0, POSITIVE, "not reproduced"),
        (0.5, POSITIVE, "inconclusive"),
        (0.0, Region(-9, 9), "reproduced"),
        (0.0, Region(-0.5, 0.5), "inconclusive"),
        (12.0, Region(-9, 9), "not reproduced"),
        (-12.0, Region(-9, 9), "not reproduced"),
    ],
)
def test_the_place_of_the_interval_is_the_verdict(estimate: float, region: Region, verdict: str) -> None:
    assert judge(Measured(estimate, 1.0, 1000), region).verdict == verdict


@pytest.mark.parametrize(
    ("estimate", "region", "verdict"),
    [
        (0.0, POSITIVE, "not reproduced"),
        (1e-9, POSITIVE, "reproduced"),
        (0.0, Region(0.0), "reproduced"),
        (0.0, Region(high=0.0), "reproduced"),
        (-1e-9, Region(0.0), "not reproduced"),
    ],
)
def test_without_variance_the_estimate_alone_decides(estimate: float, region: Region, verdict: str) -> None:
    assert judge(Measured(estimate, 0.0, 100), region, 63).verdict == verdict


def test_one_run_is_inconclusive_and_says_why() -> None:
    judgement = judge(Measured(5.0, nan, 1), POSITIVE)
    assert (judgement.verdict, judgement.runs_needed) == ("inconclusive", None)
    assert "one run" in judgement.reason


def test_no_number_is_inconclusive_and_says_why() -> None:
    judgement = judge(Measured(nan, nan, 0), POSITIVE)
    assert judgement.verdict == "inconclusive"
    assert "no number" in judgement.reason


def test_an_infinite_error_decides_nothing() -> None:
    judgement = judge(Measured(1.0, inf, 100), POSITIVE)
    assert (judgement.verdict, judgement.runs_needed) == ("inconclusive", None)


@pytest.mark.parametrize("estimate", [4.0, -4.0, 0.7])
def test_moving_the_edge_across_the_flip_margin_changes_the_verdict(estimate: float) -> None:
    measured = Measured(estimate, 1.0, 1000, scale=10)
    before = judge(measured, Region(0.0, inf, open=True))
    step = before.flip_at - 0.0
    short, beyond = (judge(measured, Region(f * step, inf, open=True)).verdict for f in (0.999, 1.001))
    assert short == before.verdict
    assert beyond != before.verdict
    assert before.flip == pytest.approx(abs(step))
    assert before.flip_percent == pytest.approx(10 * abs(step))


def test_the_margin_of_a_two_sided_region_is_that_of_its_nearer_edge() -> None:
    measured = Measured(0.5, 0.1, 1000)
    flip = judge(measured, Region(-1, 1))
    assert flip.flip_at == pytest.approx(0.5 + critical(0.025, 1000) * 0.1)
    assert judge(measured, Region(-1, flip.flip_at - 1e-9)).verdict == "inconclusive"


@pytest.mark.parametrize("measured", [Measured(0.1, 0.2, 50), Measured(0.53, 0.05, 100, "share")])
def test_the_number_of_runs_that_would_decide_does_decide(measured: Measured) -> None:
    region = Region(0.5, inf, open=True) if measured.law == "share" else POSITIVE
    needed = judge(measured, region, 20).runs_needed
    assert needed is not None
    assert judge(measured.at(needed), region, 20).verdict == "reproduced"
    assert judge(measured.at(int(needed * 0.9)), region, 20).verdict == "inconclusive"


@pytest.mark.parametrize("estimate", [0.0, 1e-6])
def test_an_estimate_on_the_edge_is_decided_by_no_number_of_runs(estimate: float) -> None:
    assert judge(Measured(estimate, 0.2, 100), POSITIVE).runs_needed is None


def test_a_printed_number_is_compared_with_the_scatter_of_both() -> None:
    se, runs, paper = 0.05, 1000, 100
    half = stats.t.ppf(0.975, 999) * np.sqrt(se**2 + se**2 * runs / paper)
    inside = judge(Measured(5.0, se, runs), Region(), 1, Printed(5 + 0.99 * half, paper))
    outside = judge(Measured(5.0, se, runs), Region(), 1, Printed(5 + 1.01 * half, paper))
    assert (inside.verdict, outside.verdict) == ("reproduced", "not reproduced")
    assert inside.resolution == pytest.approx(100 * half / (5 + 0.99 * half))
    assert inside.flip == pytest.approx(0.01 * half)


def test_a_coarse_replication_interval_reproduces_nothing() -> None:
    coarse = judge(Measured(5.0, 0.3, 1000), Region(), 1, Printed(5.1, 100))
    assert coarse.verdict == "inconclusive"
    assert coarse.resolution > 25
    assert coarse.runs_needed is None  # the paper's own 100 runs are too few, whatever we do
    ours = judge(Measured(5.0, 1.0, 10), Region(), 1, Printed(5.1, 1000))
    assert ours.runs_needed is not None
    finer = Measured(5.0, 1.0, 10).at(ours.runs_needed)
    assert judge(finer, Region(), 1, Printed(5.1, 1000)).verdict == "reproduced"


def test_the_last_printed_digit_is_granted() -> None:
    assert judge(Measured(2.1516, 0.0, 100), Region(), 1, Printed(2.15, 100)).verdict == "not reproduced"
    assert judge(Measured(2.1516, 0.0, 100), Region(), 1, Printed(2.15, 100, 0.005)).verdict == "reproduced"


def test_a_claim_of_several_cells_fails_if_one_is_outside_and_holds_if_all_are_inside() -> None:
    assert combine(["reproduced", "reproduced"]) == "reproduced"
    assert combine(["reproduced", "inconclusive"]) == "inconclusive"
    assert combine(["reproduced", "inconclusive", "not reproduced"]) == "not reproduced"
    assert combine(["reproduced", "not run"]) == "not run"


def test_a_claim_that_any_cell_may_make_holds_if_one_is_inside_and_fails_if_all_are_outside() -> None:
    assert combine(["reproduced", "not reproduced"], "any") == "reproduced"
    assert combine(["inconclusive", "not reproduced"], "any") == "inconclusive"
    assert combine(["not reproduced", "not reproduced"], "any") == "not reproduced"
    assert combine(["not run", "not reproduced"], "any") == "not run"


def test_an_exact_check_holds_up_to_its_tolerance() -> None:
    at, over = (judge(Measured(d, 0.0, 0, "exact"), Region(high=1e-9), 63).verdict for d in (1e-9, 1.1e-9))
    assert (at, over) == ("reproduced", "not reproduced")
    assert isnan(judge(Measured(nan, 0.0, 0, "exact"), Region(high=1e-9)).lower)
