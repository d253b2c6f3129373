from __future__ import annotations

import math

import pytest

from rkfbench.report.numbers import as_printed, fixed, written


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (2.48731, 0.01124, "2.487 ± 0.011"),
        (2.48731, None, "2.487"),
        (2.48731, math.nan, "2.487"),
        (47.07, 0.996, "47.1 ± 1.0"),
        (-0.4, 0.1, "−0.40 ± 0.10"),
        (12345.6, 678.9, "12350 ± 680"),
        (1.234e7, 1.2e5, "(1.234 ± 0.012)·10⁷"),
        (1.234e-12, None, "1.234·10⁻¹²"),
        (0.0, 0.0, "0 ± 0"),
        (2.1516, 1e-17, "2.15160 ± 0"),
        (-0.0001, 0.04, "0.000 ± 0.040"),
        (0.0, 0.03, "0.000 ± 0.030"),
        (1662.3, 30010.0, "1700 ± 30000"),
        (-0.0123, 0.0456, "−0.012 ± 0.046"),
        (0.0012, 0.04, "0.0012 ± 0.040"),
        (math.nan, 0.1, "nan"),
        (math.inf, None, "∞"),
        (-math.inf, None, "−∞"),
    ],
)
def test_the_error_decides_how_many_digits_are_shown(value: float, error: float | None, text: str) -> None:
    assert written(value, error).text() == text


def test_latex_keeps_signs_and_powers() -> None:
    assert written(-1.234e7, 1.2e5).tex() == r"$(-1.234 \pm 0.012) \times 10^{7}$"
    assert written(math.inf).tex() == r"$\infty$"


def test_printed_numbers_keep_their_trailing_zeros() -> None:
    assert as_printed(4.1, 2) == "4.10"
    assert as_printed(188.9, None) == "188.9"


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert fixed(-0.001, 1) == "0.0"
