from __future__ import annotations

import pytest

from rkfbench.report.words import Words


@pytest.mark.parametrize(
    ("metric", "shown"),
    [
        ("mse[px]@900", "MSE [px] at k = 900"),
        ("err_norm[px,py]@k", "error norm [px, py]"),
        ("rmse@500..560", "RMSE at k = 500 to 560"),
        ("mse@j+5", "MSE at lag 5"),
        ("share_below(name=beta)", "share of steps with beta < 1"),
        ("share_below(name=alpha,component=A,limit=0.5)", "share of steps with alpha of A < 0.5"),
        ("share_above(name=last_change,limit=0.001)", "share of steps with last change > 0.001"),
        ("mean_of(name=u_beta)", "mean u beta"),
        ("rmse(steps=outlier)[S]", "RMSE at outliers [S]"),
        ("nees(over=median)[altitude]", "median NEES [altitude]"),
        ("if_norm(every=5)", "norm of the influence function (every = 5)"),
        ("my_module:my_metric", "my_metric"),
        ("mine.py:worst[angle]", "worst[angle]"),
        ("mine.py:worst(of=a)[angle]@7", "worst(of=a)[angle] at k = 7"),
    ],
)
def test_a_metric_is_called_what_it_is(metric: str, shown: str) -> None:
    assert Words().metric(metric) == shown


def test_a_reading_is_named_with_its_caveat() -> None:
    words = Words(caveats={"guess": "Nobody knows.", "default": "A reconstruction."})
    told = [words.reading(name) for name in ("literal", "guess", "guess+switch", "default", "")]
    expected = ["Reading literal.", "Reading guess. Nobody knows.", "Reading guess+switch. Nobody knows."]
    assert told == [*expected, "A reconstruction.", ""]


def test_without_names_a_case_is_its_label_with_room_to_breathe() -> None:
    assert Words().case("R2,rate=0.2") == "R2, rate = 0.2"


def test_the_names_of_the_scenario_come_first() -> None:
    words = Words(
        {
            "R2": "precise ranges",
            "cov": "q²",
            "cov=1": "little noise",
            "R1,cov=1": "the easy one",
            "ekf": "my EKF",
            "rmse": "error",
            "rmse@5": "early error",
        }
    )
    assert words.case("R2,cov=10") == "precise ranges, q² = 10"
    assert words.case("R2,cov=1") == "precise ranges, little noise"
    assert words.case("R1,cov=1") == "the easy one"
    assert words.column("process_noise.cov") == "q²"
    assert words.filter("ekf") == "my EKF"
    assert words.filter("fpmcs[sigma=1]") == "FP-MCS, sigma = 1"
    assert words.metric("rmse@k") == "error"
    assert words.metric("rmse@5") == "early error"
    assert words.metric("rmse@6") == "error at k = 6"
