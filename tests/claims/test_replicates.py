from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from statsmodels.stats.weightstats import DescrStatsW

from rkfbench.claims.replicates import (
    STATISTICS,
    VALUES,
    mean,
    median,
    rank_interval,
    rms,
    sd,
    standard_error,
    variance,
)

X = np.random.default_rng(1).gamma(2.0, size=57)
Y = X + np.random.default_rng(2).normal(size=57)


def jackknife(of, *samples):
    """The textbook loop: the statistic without each run in turn."""
    n = len(samples[0])
    without = np.array([of(*(np.delete(sample, i) for sample in samples)) for i in range(n)])
    return np.sqrt((n - 1) / n * ((without - without.mean()) ** 2).sum())


def test_the_standard_error_of_a_mean_is_that_of_statsmodels() -> None:
    assert standard_error(mean(X)) == pytest.approx(DescrStatsW(X).std_mean, rel=1e-12)


def test_the_standard_error_of_a_paired_difference_is_that_of_the_differences() -> None:
    assert standard_error(mean(X) - mean(Y)) == pytest.approx(stats.sem(X - Y), rel=1e-10)


def test_the_standard_error_of_a_ratio_agrees_with_the_delta_method() -> None:
    r = X.mean() / Y.mean()
    delta = stats.sem(X - r * Y) / Y.mean()
    assert standard_error(mean(X) / mean(Y)) == pytest.approx(delta, rel=0.05)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (sd, lambda x: x.std(ddof=1)),
        (variance, lambda x: x.var(ddof=1)),
        (rms, lambda x: np.sqrt((x**2).mean())),
        (mean, np.mean),
    ],
)
def test_replicates_are_those_of_the_textbook_jackknife(ours, theirs) -> None:
    assert ours(X)[0] == pytest.approx(theirs(X), rel=1e-12)
    assert standard_error(ours(X)) == pytest.approx(jackknife(theirs, X), rel=1e-9)


def test_a_formula_of_statistics_has_the_jackknife_error_of_the_whole_formula() -> None:
    ours = standard_error(sd(X) / sd(Y) - mean(X) / mean(Y))
    loop = jackknife(lambda x, y: x.std(ddof=1) / y.std(ddof=1) - x.mean() / y.mean(), X, Y)
    assert ours == pytest.approx(loop, rel=1e-8)


@pytest.mark.parametrize("law", ["normal", "laplace", "exponential", "standard_t"])
def test_the_standard_error_of_a_median_is_its_spread_over_repetitions(law: str) -> None:
    draws = np.random.default_rng(3)
    sample = getattr(draws, law)(*([3] if law == "standard_t" else []), size=(2000, 101))
    claimed = np.mean([standard_error(median(x)) for x in sample[:400]])
    assert claimed == pytest.approx(np.median(sample, axis=1).std(), rel=0.12)


def test_the_error_of_a_difference_of_medians_knows_that_the_runs_are_the_same() -> None:
    draws = np.random.default_rng(4)
    common = draws.normal(size=(1500, 201))
    a, b = common + 0.2 * draws.normal(size=common.shape), common + 0.2 * draws.normal(size=common.shape)
    claimed = np.mean([standard_error(median(x) - median(y)) for x, y in zip(a[:400], b[:400], strict=True)])
    found = (np.median(a, axis=1) - np.median(b, axis=1)).std()
    alone = np.sqrt(2) * np.median(common, axis=1).std()
    assert claimed == pytest.approx(found, rel=0.25)
    assert claimed < 0.7 * alone


def test_a_median_stands_up_to_lost_runs() -> None:
    x = np.concatenate([X, [np.inf] * 10])
    assert median(x)[0] == np.median(x)
    assert np.isfinite(standard_error(median(x)))


def test_a_median_that_is_lost_itself_has_no_error() -> None:
    assert np.isnan(standard_error(median(np.array([1.0, np.inf, np.inf, np.inf]))))


@pytest.mark.parametrize("name", sorted(STATISTICS))
def test_the_order_of_the_runs_does_not_change_a_bit(name: str) -> None:
    shuffled = np.random.default_rng(5).permutation(X)
    ours, other = STATISTICS[name](X), STATISTICS[name](shuffled)
    assert ours[0] == other[0]
    assert standard_error(ours) == standard_error(other)


@pytest.mark.parametrize("name", sorted(STATISTICS))
@pytest.mark.parametrize("value", [0.1, 1e-300, 1 / 3, 1e17])
def test_equal_values_have_no_error_at_all(name: str, value: float) -> None:
    assert standard_error(STATISTICS[name](np.full(37, value))) == 0.0


@pytest.mark.parametrize("name", sorted(STATISTICS))
def test_one_run_has_no_standard_error(name: str) -> None:
    assert np.isnan(standard_error(STATISTICS[name](np.array([3.0]))))


def test_enormous_values_give_an_infinite_error_and_no_warning() -> None:
    assert standard_error(mean(np.array([1.0, 2.0, 1e300]))) == np.inf


@pytest.mark.parametrize("statistic", VALUES)
@pytest.mark.parametrize("x", [[], [2.5], [3.0, -1.0, 7.0, 0.1], [1.0, np.inf, 4.0], [1.0, np.inf, np.inf]], ids=str)
def test_a_value_alone_is_the_one_before_the_replicates(statistic: str, x: list[float]) -> None:
    values = np.array(x)
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(VALUES[statistic](values), STATISTICS[statistic](values)[:1])


@pytest.mark.parametrize("n", [6, 7, 20, 101, 1000, 5000])
def test_a_median_lies_between_two_runs_with_at_least_the_probability_asked_for(n: int) -> None:
    low, high = rank_interval(np.arange(1.0, n + 1))  # the values are their ranks
    assert low + high == n + 1
    assert stats.binom.cdf(low - 1, n, 0.5) <= 0.025 < stats.binom.cdf(low, n, 0.5)


def test_the_interval_of_a_median_is_open_where_runs_failed_and_none_where_there_are_too_few() -> None:
    assert rank_interval(np.array([*range(9), *[np.inf] * 8], float)) == (4.0, np.inf)
    assert np.isnan(rank_interval(np.arange(5.0))).all()
