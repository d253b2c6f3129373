"""Verdicts by simulation, where the truth is known: coverage, false verdicts, replication. Bounds leave 4 SE."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from math import inf, nan, sqrt

import numpy as np
import pytest

from rkfbench.claims import replicates
from rkfbench.claims.verdict import Measured, Printed, Region, interval, judge
from tests.claims.fakes import Arrays, rows_of, verdict_of

Draw = Callable[[np.random.Generator, tuple[int, ...]], np.ndarray]


def room(rate: float, repetitions: int) -> float:
    return 4 * sqrt(rate * (1 - rate) / repetitions)


def measured(replicated: np.ndarray) -> Measured:
    return Measured(float(replicated[0]), replicates.standard_error(replicated), replicated.size - 1)


LAWS: dict[str, Draw] = {
    "normal": lambda draws, size: draws.normal(size=size),
    "heavy tails": lambda draws, size: draws.standard_t(3, size=size),
    "skewed": lambda draws, size: draws.gamma(4.0, size=size) / 2 - 2,
}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("runs", [5, 30, 200])
def test_the_interval_of_one_cell_holds_the_truth_in_95_percent(law: str, runs: int) -> None:
    n = 3000
    sample = LAWS[law](np.random.default_rng(1), (n, runs))
    intervals = [interval(measured(replicates.mean(x)), 0.025) for x in sample]
    covered = np.mean([low <= 0 <= high for low, high in intervals])
    loss = {"normal": 0.0, "heavy tails": 0.0, "skewed": 0.06 / sqrt(runs)}[law]
    assert covered >= 0.95 - loss - room(0.05, n)
    if law == "normal":
        assert covered <= 0.95 + room(0.05, n)


STATISTICS: dict[str, tuple[Callable[[np.ndarray, np.ndarray], np.ndarray], float]] = {
    "difference of means": (lambda x, y: replicates.mean(x) - replicates.mean(y), 1.0),
    "ratio of means": (lambda x, y: replicates.mean(x) / replicates.mean(y), 6 / 5),
    "difference of medians": (lambda x, y: replicates.median(x) - replicates.median(y), 1.0),
    "ratio of sd": (lambda x, y: replicates.sd(x) / replicates.sd(y), sqrt(1.25) / sqrt(1.25)),
    "pooled rmse": (lambda x, y: replicates.rms(x), sqrt(36 + 1.25)),
    "variance": (lambda x, y: replicates.variance(x), 1.25),
}


@pytest.mark.parametrize("name", STATISTICS)
def test_intervals_of_all_statistics_hold_the_truth_in_about_95_percent(name: str) -> None:
    of, truth = STATISTICS[name]
    n, runs = 1500, 150
    draws = np.random.default_rng(2)
    common = draws.normal(size=(n, runs))
    x, y = 6 + common + 0.5 * draws.normal(size=(n, runs)), 5 + common + 0.5 * draws.normal(size=(n, runs))
    found = [interval(measured(of(*pair)), 0.025) for pair in zip(x, y, strict=True)]
    covered = np.mean([low <= truth <= high for low, high in found])
    assert 0.95 - 0.01 - room(0.05, n) <= covered <= 0.99


@pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.995])
def test_the_interval_of_a_share_never_covers_less_than_promised(share: float) -> None:
    n, runs = 4000, 100
    wins = np.random.default_rng(3).binomial(runs, share, n)
    table = [interval(Measured(k / runs, nan, runs, "share"), 0.025) for k in range(runs + 1)]
    covered = np.mean([table[k][0] <= share <= table[k][1] for k in wins])
    assert covered >= 0.95 - room(0.05, n)


@pytest.mark.parametrize(("win", "tie"), [(0.4, 0.6), (0.6, 0.3), (0.1, 0.1)])
def test_the_interval_of_a_share_with_ties_never_covers_less_than_promised(win: float, tie: float) -> None:
    n, runs, truth = 1000, 100, win + tie / 2
    drawn = np.random.default_rng(3).multinomial(runs, [win, tie, abs(1 - win - tie)], n)
    found = [
        interval(Measured((w + t / 2) / runs, nan, runs, "share", int(t)), 0.025, Region(0.7)) for w, t, _ in drawn
    ]
    assert np.mean([low <= truth <= high for low, high in found]) >= 0.95 - room(0.05, n)


def test_spreads_are_judged_as_strictly_as_a_family_needs() -> None:
    n, runs, family = 3000, 200, 100
    draws = np.random.default_rng(6).exponential(size=(n, runs))
    logs = [np.log(replicates.sd(x)) for x in draws]
    spreads = [
        Measured(float(np.exp(each[0])), float(np.exp(each[0])) * replicates.standard_error(each), runs, "log")
        for each in logs
    ]
    below, above = (
        np.mean(side) for side in zip(*(_misses(each, 1.0, 0.025 / family) for each in spreads), strict=True)
    )
    symmetric = np.mean([_misses(replace(each, law="t"), 1.0, 0.025 / family)[0] for each in spreads])
    assert below + above < 0.5 * symmetric


def _misses(measured: Measured, truth: float, tail: float) -> tuple[bool, bool]:
    low, high = interval(measured, tail)
    return high < truth, low > truth


@pytest.mark.parametrize(("scale", "least"), [((1.0, 1.0, 1.0, 1.0), 0.0), ((5.0, 5.0, 1.0, 1.0), 0.05)])
def test_the_least_eigenvalue_of_a_consistent_filter_is_not_below_zero_by_selection(
    scale: tuple[float, ...], least: float
) -> None:
    """Excess P - e e' of a filter that states its covariance rightly, or too large by `least`."""
    n, runs, names = 200, 200, [f"e{i}{j}" for i in range(4) for j in range(i + 1)]
    draws, stated = np.random.default_rng(7), np.diag(np.square(scale)) + least * np.eye(4)
    claim = {"eigenvalue": {"metric": names, "filters": "a", "below": -1e-9}}
    missed = false = 0
    for _ in range(n):
        e = draws.normal(size=(runs, 4)) * scale
        entries = {("", "a", f"e{i}{j}"): stated[i, j] - e[:, i] * e[:, j] for i in range(4) for j in range(i + 1)}
        (row,) = rows_of(claim, Arrays(entries))
        missed += not row.judgement.lower <= least <= row.judgement.upper
        false += row.verdict == "reproduced"
    assert missed <= n * (0.05 + room(0.05, n))
    assert false <= n * (0.025 + room(0.025, n))


def test_a_family_of_40_holds_all_its_truths_in_95_percent() -> None:
    n, runs, family = 400, 100, 40
    draws = np.random.default_rng(4)
    all_held = 0
    for _ in range(n):
        common = draws.normal(size=runs)
        cells = 0.7 * common + draws.normal(size=(family, runs))  # filters share the data
        found = [interval(measured(replicates.mean(x)), 0.025 / family) for x in cells]
        all_held += all(low <= 0 <= high for low, high in found)
    assert all_held / n >= 0.95 - room(0.05, n)


FILTERS = ("a", "b", "c")
CASES = ("q=0", "q=1", "q=2")


def runs_with(draws: np.random.Generator, levels: np.ndarray, runs: int = 80) -> Arrays:
    """Runs around levels (cases, filters) that share most of their noise."""
    common = draws.normal(size=runs)
    return Arrays(
        {
            (case, filter, "e"): levels[i, j] + common + 0.5 * draws.normal(size=runs)
            for i, case in enumerate(CASES)
            for j, filter in enumerate(FILTERS)
        }
    )


def levels(a: object, b: object = 5.0, c: object = 5.0) -> np.ndarray:
    return np.stack([np.broadcast_to(np.asarray(each, float), 3) for each in (a, b, c)], axis=1)


BASE = {"metric": "e", "filters": "a", "cases": "q=0"}
PAIR = BASE | {"filters": ["a", "b"]}
# kind: claim, levels at which it is true, on the edge, false
FORMS: dict[str, tuple[dict, np.ndarray, np.ndarray, np.ndarray]] = {
    "ordering": ({"ordering": PAIR}, levels(5.5), levels(5), levels(4.5)),
    "ordering of three": (
        {"ordering": PAIR | {"filters": ["a", "b", "c"]}},
        levels(6, 5.5, 5),
        levels(5.5, 5, 5),
        levels(5, 5, 5.5),
    ),
    "best": ({"best": PAIR | {"filters": ["a", "b", "c"]}}, levels(4.5), levels(5), levels(5.5)),
    "trend": ({"trend": BASE | {"cases": CASES}}, levels([5, 5.5, 6]), levels([5, 5, 5.5]), levels([5, 5.5, 5])),
    "shape": (
        {"shape": BASE | {"cases": CASES, "steps": ["down", "up"]}},
        levels([5, 4.5, 5]),
        levels([5, 4.5, 4.5]),
        levels([5, 5.5, 6]),
    ),
    "equal": ({"equal": PAIR | {"margin": 0.1}}, levels(5.1), levels(5.5), levels(6)),
    "equal over cases": (
        {"equal": BASE | {"along": "cases", "cases": CASES, "margin": 0.2}},
        levels([5, 5.1, 5]),
        levels([5, 6, 6]),
        levels([5, 6, 7]),
    ),
    "bound": ({"bound": BASE | {"above": 5}}, levels(5.6), levels(5), levels(4.4)),
    "ratio": ({"ratio": PAIR | {"above": 1.1}}, levels(6), levels(5.5), levels(5)),
    "share": ({"share": PAIR}, levels(4.5), levels(5), levels(5.5)),
    "slope": ({"slope": BASE | {"cases": CASES, "above": 0}}, levels([5, 5.3, 5.6]), levels(5), levels([5, 4.7, 4.4])),
}


@pytest.mark.parametrize("name", FORMS)
def test_false_verdicts_are_as_rare_as_promised_inside_on_the_edge_and_outside(name: str) -> None:
    claim, true, edge, false = FORMS[name]
    draws, n = np.random.default_rng(5), 160
    found = {
        place: Counter(verdict_of(claim, runs_with(draws, at)) for _ in range(n))
        for place, at in (("true", true), ("edge", edge), ("false", false))
    }
    bound = 0.025 + room(0.025, n)
    assert found["true"]["not reproduced"] <= bound * n
    assert found["edge"]["reproduced"] <= bound * n
    assert found["edge"]["not reproduced"] <= (0.05 + room(0.05, n)) * n  # several cells may lie on their edge
    assert found["false"]["reproduced"] <= bound * n
    assert found["true"]["reproduced"] > 0.8 * n  # and the test has power
    assert found["false"]["not reproduced"] > 0.8 * n


def test_a_win_probability_on_the_edge_is_decided_as_rarely_as_promised() -> None:
    draws, n, runs = np.random.default_rng(6), 400, 80
    claim = {"ordering": PAIR | {"cases": ""}}
    found: Counter[str] = Counter()
    for _ in range(n):
        a, b = draws.standard_cauchy((2, runs))
        both = draws.random((2, runs)) < 0.1
        stats = Arrays({("", "a", "e"): a, ("", "b", "e"): b}, lost={("", "a"): both[0], ("", "b"): both[1]})
        found[verdict_of(claim, stats)] += 1
    for verdict in ("reproduced", "not reproduced"):
        assert found[verdict] <= (0.025 + room(0.025, n)) * n


@pytest.mark.parametrize("law", LAWS)
def test_a_table_printed_by_the_suite_itself_comes_out_reproduced_in_95_percent(law: str) -> None:
    """100 runs print a table of 8 means and 8 standard deviations; 1000 runs with another seed judge it."""
    draws, n, cells = np.random.default_rng(7), 150, 8
    tables = 0
    single: list[bool] = []
    for _ in range(n):
        theirs, ours = (50 + 5 * LAWS[law](draws, (cells, runs)) for runs in (100, 1000))
        verdicts = []
        for x, y in zip(theirs, ours, strict=True):
            for of, printed in ((replicates.mean, x.mean()), (replicates.sd, x.std(ddof=1))):
                estimate = measured(of(y))
                spread = law == "heavy tails" and of is replicates.sd  # no finite kurtosis: nobody can know its error
                if not spread:
                    verdicts.append(judge(estimate, Region(), 2 * cells, Printed(printed, 100)).verdict)
                    single.append(judge(estimate, Region(), 1, Printed(printed, 100)).verdict != "not reproduced")
        tables += "not reproduced" not in verdicts
    assert tables / n >= 0.95 - room(0.05, n)
    assert np.mean(single) >= 0.95 - 0.01 - room(0.05, len(single) // 8)


def test_a_table_of_another_experiment_comes_out_not_reproduced() -> None:
    draws = np.random.default_rng(8)
    x, y = 50 + 5 * draws.normal(size=100), 55 + 5 * draws.normal(size=1000)
    assert judge(measured(replicates.mean(y)), Region(), 16, Printed(x.mean(), 100)).verdict == "not reproduced"


def test_a_printed_share_of_runs_is_replicated_too() -> None:
    draws, n = np.random.default_rng(9), 2000
    kept = 0
    for ours, theirs in zip(draws.binomial(1000, 0.03, n), draws.binomial(100, 0.03, n), strict=True):
        estimate = Measured(ours / 1000, nan, 1000, "share")
        kept += judge(estimate, Region(), 1, Printed(theirs / 100, 100)).verdict != "not reproduced"
    assert kept / n >= 0.95 - room(0.05, n)


def test_ever_more_families_make_wider_intervals() -> None:
    widths = [judge(Measured(1.0, 1.0, 100), Region(0, inf), family).upper for family in (1, 10, 100)]
    assert widths == sorted(widths)
    assert widths[0] < widths[2]


def test_the_order_of_the_runs_does_not_change_a_row() -> None:
    draws = np.random.default_rng(10)
    stats = runs_with(draws, levels(6, 5, 4))
    order = draws.permutation(stats.runs)
    shuffled = Arrays({key: column[order] for key, column in stats.arrays.items()})
    for name, (claim, *_) in FORMS.items():
        ours, theirs = rows_of(claim, stats), rows_of(claim, shuffled)
        assert [repr((row.observed, row.judgement)) for row in ours] == [
            repr((row.observed, row.judgement)) for row in theirs
        ], name
