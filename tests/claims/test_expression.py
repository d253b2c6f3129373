from __future__ import annotations

import pytest

from rkfbench.claims.expression import parse

VALUES = {"a": 12.0, "b": 4.0, "c": 2.0, "ca-ckf": 3.0, "mse[px]@900": 5.0, "f(x=1)": 7.0, "R2,rate=0.2": 8.0}
VALUES["R 2"] = 9.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a", 12),
        ("a - b - c", 6),
        ("a / b / c", 1.5),
        ("a - b * c", 4),
        ("(a - b) * c", 16),
        ("(a - b) / (a - c)", 0.8),
        ("((a))", 12),
        ("0.5 * a - b", 2),
        ("2 * (b + c)", 12),
        ("ca-ckf - c", 1),
        ("mse[px]@900 / c", 2.5),
        ("(f(x=1) - c) * c", 10),
        ("(c - f(x=1))", -5),
        ("R2,rate=0.2 / b", 2),
        ("R 2 - c", 7),
    ],
)
def test_arithmetic_over_names_is_read_with_the_usual_precedence(text: str, expected: float) -> None:
    assert parse(text).evaluate(VALUES.__getitem__) == pytest.approx(expected)


def test_names_are_listed_once_in_order() -> None:
    assert parse("(b - a) / (b - c)").names() == ("b", "a", "c")


def test_the_empty_text_is_the_case_without_a_label() -> None:
    assert parse("").names() == ("",)


@pytest.mark.parametrize("text", ["a -", "- a", "(a - b", "a - b)", "a * / b", "3", "()", "2 * 3", "a - ( b"])
def test_what_is_no_expression_is_refused_with_its_text(text: str) -> None:
    with pytest.raises(ValueError, match="'"):
        parse(text)
