"""Each kind of claim on constructed runs: what it measures, and how its cells are written."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats as stats_of

from rkfbench.claims.forms import slope_weights
from rkfbench.errors import SpecError
from tests.claims.fakes import Arrays, rows_of, verdict_of

M = 200
RNG = np.random.default_rng(7)
COMMON = RNG.normal(size=M)


def runs(level: float, spread: float = 0.3) -> np.ndarray:
    return level + COMMON + spread * RNG.normal(size=M)


STATS = Arrays(
    {
        ("rate=0", "a", "e"): runs(10),
        ("rate=0", "b", "e"): runs(9),
        ("rate=0", "c", "e"): runs(5),
        ("rate=1", "a", "e"): runs(14),
        ("rate=1", "b", "e"): runs(10),
        ("rate=1", "c", "e"): runs(5.05),
        ("rate=4", "a", "e"): runs(26),
        ("rate=4", "b", "e"): runs(13),
        ("rate=4", "c", "e"): runs(5.1),
        ("rate=0", "a", "g"): runs(20),
        ("rate=0", "b", "g"): runs(8),
    }
)
ALL = ["rate=0", "rate=1", "rate=4"]


def column(case: str, filter: str, metric: str = "e") -> np.ndarray:
    return STATS.arrays[case, filter, metric]


def texts(claim: dict) -> list[str]:
    return [row.cell.form.text for row in rows_of(claim, STATS)]


def test_an_ordering_is_a_paired_difference() -> None:
    (row,) = rows_of({"ordering": {"metric": "e", "filters": ["a", "b"], "cases": "rate=0"}}, STATS)
    difference = column("rate=0", "a") - column("rate=0", "b")
    test = stats_of.ttest_rel(column("rate=0", "a"), column("rate=0", "b")).confidence_interval(0.95)
    assert row.observed is not None
    assert row.observed.measured.estimate == pytest.approx(difference.mean())
    assert (row.judgement.lower, row.judgement.upper) == pytest.approx((test.low, test.high))
    assert row.verdict == "reproduced"


def test_groups_are_compared_each_with_each_and_lists_neighbour_by_neighbour() -> None:
    base = {"metric": "e", "cases": "rate=0"}
    assert texts({"ordering": base | {"filters": ["a", ["b", "c"]]}}) == [
        "a - b in e at rate=0",
        "a - c in e at rate=0",
    ]
    assert texts({"ordering": base | {"filters": ["a", "b", "c"]}}) == ["a - b in e at rate=0", "b - c in e at rate=0"]
    assert texts({"best": base | {"filters": ["c", "a", "b"]}}) == ["a - c in e at rate=0", "b - c in e at rate=0"]


def test_what_is_not_compared_is_crossed() -> None:
    claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "cases": ALL}}
    assert texts(claim) == [f"a - b in e at {case}" for case in ALL]


@pytest.mark.parametrize(
    ("claim", "verdict"),
    [
        ({"ordering": {"metric": "e", "filters": ["a", "b", "c"], "cases": ALL}}, "reproduced"),
        ({"ordering": {"metric": "e", "filters": ["c", "b"], "cases": ALL}}, "not reproduced"),
        ({"ordering": {"metric": "e", "filters": ["a", "b"], "cases": "rate=0", "margin": 2}}, "not reproduced"),
        ({"ordering": {"along": "cases", "metric": "e", "filters": "a", "cases": ["rate=4", "rate=0"]}}, "reproduced"),
        ({"ordering": {"along": "metric", "metric": ["g", "e"], "filters": "a", "cases": "rate=0"}}, "reproduced"),
        ({"best": {"metric": "e", "filters": ["c", "a", "b"], "cases": ALL}}, "reproduced"),
        ({"trend": {"metric": "e", "filters": "a", "cases": ALL}}, "reproduced"),
        ({"trend": {"metric": "e", "filters": "a - b", "cases": ALL}}, "reproduced"),
        ({"trend": {"metric": "e", "filters": "a", "cases": ALL, "direction": "down"}}, "not reproduced"),
        ({"shape": {"metric": "e", "filters": "a", "cases": [*ALL, "rate=0"], "steps": ["up", "up", "down"]}}, None),
        ({"equal": {"metric": "e", "filters": ["b", "a"], "cases": "rate=0", "margin": 0.15}}, "reproduced"),
        ({"equal": {"metric": "e", "filters": ["b", "a"], "cases": "rate=0", "margin": 0.05}}, "not reproduced"),
        ({"equal": {"along": "cases", "metric": "e", "filters": "c", "cases": ALL, "margin": 0.2}}, "reproduced"),
        ({"equal": {"along": "cases", "metric": "e", "filters": "a", "cases": ALL, "margin": 0.2}}, "not reproduced"),
        ({"bound": {"metric": "e", "filters": "a", "cases": "rate=0", "above": 9, "below": 11}}, "reproduced"),
        ({"bound": {"metric": "e", "filters": "(a - b) / (a - c)", "cases": "rate=4", "above": 0.5}}, "reproduced"),
        ({"bound": {"metric": "g / e", "filters": "a", "cases": "rate=0", "above": 1.9, "below": 2.1}}, "reproduced"),
        ({"ratio": {"metric": "e", "filters": ["a", "b"], "cases": "rate=4", "above": 1.9}}, "reproduced"),
        ({"ratio": {"along": "cases", "metric": "e", "filters": "a", "cases": ["rate=4", "rate=0"], "above": 2}}, None),
        ({"share": {"metric": "e", "filters": ["c", "a", "b"], "cases": ALL, "above": 0.9}}, "reproduced"),
        ({"share": {"metric": "e", "filters": ["a", "b"], "cases": "rate=0"}}, "not reproduced"),
        ({"slope": {"metric": "e", "filters": "a", "cases": ALL, "above": 3.5, "below": 4.5}}, "reproduced"),
        ({"slope": {"metric": "e", "filters": "0.5 * a - b", "cases": ALL, "above": 0}}, "reproduced"),
    ],
)
def test_each_kind_decides_what_its_words_say(claim: dict, verdict: str | None) -> None:
    assert verdict_of(claim, STATS) == (verdict or "reproduced")


def test_a_claim_that_something_may_happen_holds_if_it_happens_once() -> None:
    claim = {"bound": {"metric": "e", "filters": "a", "cases": ALL, "above": 20}}
    assert verdict_of(claim, STATS) == "not reproduced"
    assert verdict_of(claim | {"holds": "any"}, STATS) == "reproduced"


def test_arithmetic_over_filters_stands_within_arithmetic_over_cases() -> None:
    claim = {"bound": {"metric": "e", "filters": "a / b", "cases": "rate=4 - rate=0", "above": 0}}
    (row,) = rows_of(claim, STATS)
    expected = column("rate=4", "a").mean() / column("rate=4", "b").mean()
    expected -= column("rate=0", "a").mean() / column("rate=0", "b").mean()
    assert row.observed is not None
    assert row.observed.measured.estimate == pytest.approx(expected)


def test_the_slope_is_the_least_squares_slope_over_the_swept_numbers() -> None:
    (row,) = rows_of({"slope": {"metric": "e", "filters": "a", "cases": ALL, "above": 0}}, STATS)
    per_run = [stats_of.linregress([0, 1, 4], y).slope for y in zip(*(column(c, "a") for c in ALL), strict=True)]
    assert row.observed is not None
    assert row.observed.measured.estimate == pytest.approx(np.mean(per_run))
    assert row.observed.measured.se == pytest.approx(stats_of.sem(per_run))


def test_the_least_eigenvalue_lies_between_that_of_the_mean_and_one_along_a_direction_chosen_on_other_runs() -> None:
    x = np.random.default_rng(2).normal(size=(M, 2)) @ [[2.0, 0.6], [0.0, 0.5]]
    entries = {"e11": x[:, 0] ** 2, "e21": x[:, 0] * x[:, 1], "e22": x[:, 1] ** 2}
    runs_ = Arrays({("", "a", name): each for name, each in entries.items()})
    body = {"metric": list(entries), "filters": "a", "above": 0}
    (row,) = rows_of({"eigenvalue": body}, runs_)
    assert row.observed is not None
    measured, (first, second) = row.observed.measured, (x[: M // 2], x[M // 2 :])
    assert row.observed.mean == measured.floor == pytest.approx(np.linalg.eigvalsh(x.T @ x / M)[0])
    along = (second @ np.linalg.eigh(first.T @ first).eigenvectors[:, 0]) ** 2
    assert (measured.estimate, measured.se) == pytest.approx((along.mean(), stats_of.sem(along)))
    c = stats_of.t.ppf(0.975, M // 2 - 1)
    assert (row.judgement.lower, row.judgement.upper) == pytest.approx(
        (min(measured.floor, measured.estimate) - c * measured.se, measured.estimate + c * measured.se)
    )
    assert row.verdict == "reproduced"
    assert row.cell.form.text == "a in least eigenvalue of 2 x 2 e11 .. e22"
    with pytest.raises(SpecError, match="2 entries are no lower triangle"):
        rows_of({"eigenvalue": {**body, "metric": ["e11", "e21"]}}, runs_)


def test_points_of_a_slope_are_given_or_stand_in_the_labels() -> None:
    assert slope_weights(("R1,q=1", "R1,q=3")) == slope_weights(("x", "y"), [1, 3]) == (-0.5, 0.5)
    with pytest.raises(SpecError, match="one number each"):
        slope_weights(("R1", "R2"))
    with pytest.raises(SpecError, match="3 points for 2 items"):
        slope_weights(("a", "b"), [1, 2, 3])


def test_statistics_other_than_the_mean_are_measured_too() -> None:
    noise = COMMON - np.median(COMMON)
    wide = Arrays({("", "a", "e"): 5 + 3 * noise, ("", "b", "e"): 5 + 1 * noise})
    for statistic, verdict in (("sd", "reproduced"), ("variance", "reproduced"), ("rms", "reproduced")):
        claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "statistic": statistic}}
        assert verdict_of(claim, wide) == verdict, statistic
    claim = {"ordering": {"metric": "e", "filters": ["a", "b"], "statistic": "median"}}
    assert verdict_of(claim, wide) == "inconclusive"
    assert verdict_of(claim, Arrays({("", "a", "e"): 8 + 3 * noise, ("", "b", "e"): 5 + noise})) == "reproduced"
    claim = {"ratio": {"metric": "e", "filters": ["a", "b"], "statistic": "sd", "above": 2.9, "below": 3.1}}
    assert verdict_of(claim, wide) == "reproduced"


def test_which_spread_is_larger_is_asked_of_their_ratio() -> None:
    body = {"metric": "e", "filters": ["a", "b"], "cases": "rate=4", "statistic": "sd"}
    (row,) = rows_of({"ordering": body}, STATS)
    a, b = (column("rate=4", name).std(ddof=1) for name in "ab")
    assert row.observed is not None
    assert (row.cell.form.text, row.observed.measured.law) == ("a / b in sd of e at rate=4", "log")
    assert row.observed.measured.estimate == pytest.approx(a / b)
    assert row.judgement.lower * row.judgement.upper == pytest.approx((a / b) ** 2)
    assert str(row.region) == "> 1"
    (row,) = rows_of({"ordering": body | {"margin": 0.1}}, STATS)
    assert row.cell.form.text == "a - b in sd of e at rate=4"
    (row,) = rows_of({"ordering": body | {"metric": "g - e", "cases": "rate=0"}}, STATS)
    assert row.cell.form.text == "a - b in sd of g - e at rate=0"  # may be negative: no ratio


def test_an_ordering_of_shares_with_a_margin_is_one_of_their_difference() -> None:
    draws = np.random.default_rng(8)
    drawn = Arrays({("", name, "hit"): (draws.random(1000) < p) * 1.0 for name, p in (("a", 0.5), ("b", 0.1))})
    claim = {"ordering": {"metric": "hit", "filters": ["a", "b"], "margin": 0.2}}
    (row,) = rows_of(claim, drawn)
    assert row.observed is not None
    assert (row.observed.decided_on, row.observed.measured.law) == ("estimate", "shares")
    assert row.verdict == "reproduced"
    claim["ordering"]["margin"] = 0.6
    assert verdict_of(claim, drawn) == "not reproduced"


def test_a_bound_on_lost_runs_has_an_exact_interval() -> None:
    stats_ = Arrays({("", "a", "e"): COMMON}, lost={("", "a"): np.arange(M) < 1})
    (row,) = rows_of({"bound": {"metric": "lost", "filters": "a", "below": 0.05}}, stats_)
    assert row.observed is not None
    assert (row.observed.measured.law, row.observed.measured.estimate) == ("share", 1 / M)
    assert row.verdict == "reproduced"
    none = Arrays({("", "a", "e"): COMMON})
    assert verdict_of({"bound": {"metric": "lost", "filters": "a", "below": 0.001}}, none) == "inconclusive"


def test_a_constant_zero_of_another_metric_is_no_share() -> None:
    exact = Arrays({("", "a", "e"): np.zeros(M)})
    assert verdict_of({"bound": {"metric": "e", "filters": "a", "below": 1e-9}}, exact) == "reproduced"


def test_a_selection_is_made_on_tuning_runs_and_judged_on_the_others() -> None:
    from rkfbench.claims.ledger import ledger
    from rkfbench.claims.plan import plan
    from rkfbench.scenario.paper_schema import Paper
    from tests.claims.fakes import outline_of

    tuning = Arrays({("", "b", "e"): runs(9), ("", "c", "e"): runs(5), ("", "a", "e"): runs(7)})
    test = Arrays({("", "b", "e"): runs(4), ("", "c", "e"): runs(8), ("", "a", "e"): runs(7)}, tuning=tuning)
    paper = Paper.model_validate(
        {
            "cite": "x",
            "scenarios": ["s"],
            "select": {"best": {"from": ["b", "c"], "metric": "e"}},
            "claims": [{"id": "c", "says": "x", "ordering": {"metric": "e", "filters": ["best", "a"]}}],
        }
    )
    outlines = {"s": outline_of(test)}
    (row,) = ledger(paper, plan(paper, outlines), {"s": test}, outlines)
    assert row.observed is not None
    assert row.observed.chosen == "c"
    assert row.observed.measured.estimate == pytest.approx((column_of(test, "c") - column_of(test, "a")).mean())
    tuning.arrays["", "c", "e"] = np.where(np.arange(M) < 1, np.nan, tuning.arrays["", "c", "e"])
    (row,) = ledger(paper, plan(paper, outlines), {"s": test}, outlines)
    assert row.observed is not None
    assert row.observed.chosen == "b"  # a candidate that failed on a tuning run is not taken
    test.tuning = None
    (row,) = ledger(paper, plan(paper, outlines), {"s": test}, outlines)
    assert row.verdict == "not run"


def column_of(stats_: Arrays, filter: str) -> np.ndarray:
    return stats_.arrays["", filter, "e"]
