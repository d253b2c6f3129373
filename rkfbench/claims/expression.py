"""Small arithmetic over names: `hkf - aladkf`, `rate=0.05 / rate=0`, `0.5 * ekf - pekf`, `(a - b) / (a - c)`.

Names of filters, cases and metrics hold almost any character (`hkf[threshold=0.5]`, `mse[px]@900`, `ca-ckf`), so an
operator counts only between spaces, and a parenthesis only at the outer end of a word. `*` and `/` bind closer than
`+` and `-`; equal operators go from left to right.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_NUMBER = re.compile(r"\d+(\.\d*)?|\.\d+")


@dataclass(frozen=True)
class Expression:
    """A name, a number, or an operator between two expressions; `text` is what was written."""

    text: str
    name: str | None = None
    number: float | None = None
    op: str = ""
    left: Expression | None = None
    right: Expression | None = None

    def names(self) -> tuple[str, ...]:
        """All names in it, from left to right, each once."""
        if self.name is not None:
            return (self.name,)
        if self.left is None or self.right is None:
            return ()
        return tuple(dict.fromkeys(self.left.names() + self.right.names()))

    @property
    def degree(self) -> int | None:
        """0 for a number, 1 where it is linear in its names (`a - b`, `0.5 * a`), None for anything else."""
        if self.name is not None:
            return 1
        if self.left is None or self.right is None:
            return 0
        left, right = self.left.degree, self.right.degree
        if left is None or right is None:
            return None
        if self.op in "+-":
            return left if left == right else None
        if self.op == "/":
            return left if right == 0 else None
        return left + right if left + right < 2 else None

    def evaluate(self, value: Callable[[str], Any]) -> Any:
        """The value of the expression where `value(name)` gives that of a name: a number or an array."""
        if self.name is not None:
            return value(self.name)
        if self.left is None or self.right is None:
            return self.number
        return _OPERATORS[self.op](self.left.evaluate(value), self.right.evaluate(value))


@cache
def parse(text: str) -> Expression:
    """The expression that `text` writes.

    Raises ValueError for unbalanced parentheses, a missing operand, or an expression that names nothing.
    """
    tokens = _tokens(text)
    expression, rest = _sum(tokens, text)
    if rest:
        raise ValueError(f"'{text}': unexpected '{rest[0]}'")
    if not expression.names():
        raise ValueError(f"'{text}': names nothing")
    return expression


def _tokens(text: str) -> list[str]:
    """Words, operators and grouping parentheses; neighbouring words are one name with a space in it."""
    if not text.strip():
        return [""]  # the case without a label
    tokens: list[str] = []
    joins = False
    for word in text.split():
        opening = len(word) - len(word.lstrip("("))
        body = word[opening:]
        closing = 0
        while body.endswith(")") and body.count(")") > body.count("("):
            body, closing = body[:-1], closing + 1
        tokens += "(" * opening
        if body in _OPERATORS:
            tokens.append(body)
            joins = False
        elif body:
            if joins and not opening:
                tokens[-1] += f" {body}"
            else:
                tokens.append(body)
            joins = True
        if closing or not body:
            joins = False
        tokens += ")" * closing
    return tokens


def _sum(tokens: list[str], text: str) -> tuple[Expression, list[str]]:
    return _chain(tokens, text, "+-", _product)


def _product(tokens: list[str], text: str) -> tuple[Expression, list[str]]:
    return _chain(tokens, text, "*/", _atom)


def _chain(
    tokens: list[str],
    text: str,
    operators: str,
    part: Callable[[list[str], str], tuple[Expression, list[str]]],
) -> tuple[Expression, list[str]]:
    left, tokens = part(tokens, text)
    while tokens and tokens[0] in operators and tokens[0] in _OPERATORS:
        op = tokens[0]
        right, tokens = part(tokens[1:], text)
        left = Expression(text, op=op, left=left, right=right)
    return left, tokens


def _atom(tokens: list[str], text: str) -> tuple[Expression, list[str]]:
    if not tokens or tokens[0] in _OPERATORS or tokens[0] == ")":
        raise ValueError(f"'{text}': a name is missing{f' before {tokens[0]!r}' if tokens else ' at the end'}")
    head, *rest = tokens
    if head == "(":
        inside, rest = _sum(rest, text)
        if not rest or rest[0] != ")":
            raise ValueError(f"'{text}': a closing parenthesis is missing")
        return inside, rest[1:]
    if _NUMBER.fullmatch(head):
        return Expression(text, number=float(head)), rest
    return Expression(text, name=head), rest
