"""The kinds of claims written out: each measurement becomes cells with one estimand and one claimed region.

    ordering a, b, c   a - b > margin and b - c > margin    best a, b, c    b - a > 0 and c - a > 0
    trend a, b, c      b - a > 0 and c - b > 0              shape a, b, c   the same with a sign for each step
    equal a, b         (a - b)/b within +- margin           equal a, b, c   all a/b within 1/(1+margin) .. 1+margin
    ratio a, b, c      a/b and a/c within bounds            share a, b, c   share of runs with a < min(b, c)
    bound, slope       the number within bounds             value           printed numbers
    eigenvalue a, b, c the least eigenvalue of [[a, b], [b, c]] within bounds

What is chosen by looking at the data (the best, the largest, the runner-up) is never one cell: it is written as all
the pairs it stands for, so that nothing is selected and the interval of each is right. The least eigenvalue is the one
exception: its direction is found on one half of the runs and judged on the other. Which of two standard deviations or
variances is the larger is asked of their ratio, a/b > 1, whose logarithm has the better interval.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise, product
from math import inf
from typing import Any

from rkfbench.claims.combinations import triangle
from rkfbench.claims.estimand import Combination, Estimand, Point, Selected
from rkfbench.claims.expression import Expression, parse
from rkfbench.claims.verdict import Printed, Region
from rkfbench.errors import SpecError, did_you_mean
from rkfbench.scenario.claims import Measurement, Part, Value
from rkfbench.scenario.paper_schema import Paper

_SINGULAR = {"cases": "case", "filters": "filter", "metric": "metric"}  # in the order of crossing, slowest first
_ALL = Region()
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"


@dataclass(frozen=True)
class Form:
    """One cell before it meets a reading: its words, estimand and region, and the parts of a templated claim id."""

    scenario: str
    text: str
    estimand: Estimand | None = None
    region: Region = _ALL
    printed: Printed | None = None
    check: str = ""
    reason: str = ""
    row: str = ""
    column: str = ""


def forms(paper: Paper, part: Part) -> list[Form]:
    """The cells of a measurement under one reading, in a fixed order.

    Raises SpecError (path relative to the measurement) where it cannot be written out.
    """
    body, default = part.body, paper.scenarios[0]
    if part.kind in ("unsupported", "not_testable"):
        return [Form(default, part.kind.replace("_", " "), reason=body.reason)]
    if part.kind == "exact":
        return [Form(body.scenario or default, f"deviation of {each}", check=each) for each in body.checks]
    if isinstance(body, Value):
        return list(_printed(paper, body))
    return list(_crossed(paper, part.kind, body))


def _printed(paper: Paper, value: Value) -> Iterator[Form]:
    """The cells of a printed table, row by row."""
    table = paper.tables.get(value.table)
    if table is None:
        raise SpecError(f"unknown table '{value.table}'{did_you_mean(value.table, paper.tables)}", ("table",))
    rows = _chosen("rows", value.rows, [row.label for row in table.rows])
    columns = _chosen("columns", value.columns, [column.label for column in table.columns])
    rounding = 0.5 * 10.0**-table.decimals if table.decimals is not None else 0.0
    for row in table.rows:
        for column, number in table.numbers(row):
            if number is None or row.label not in rows or column.label not in columns:
                continue
            try:
                names = table.cell(row, column)
            except ValueError as error:
                raise SpecError(str(error), ("table",)) from error
            point = Point(parse(names["metric"]), parse(names["filter"]), parse(names["case"]))
            yield Form(
                scenario=table.scenario or paper.scenarios[0],
                text=_words("value", (point,), names["statistic"]),
                estimand=Estimand("value", (point,), names["statistic"], selected=_selected(paper, (point,))),
                printed=Printed(number, table.runs, rounding),
                row=_slug(row.label),
                column=_slug(column.label),
            )


def _chosen(key: str, wanted: list[str] | None, labels: list[str]) -> list[str]:
    for i, label in enumerate(wanted or ()):
        if label not in labels:
            raise SpecError(f"unknown {key[:-1]} '{label}'{did_you_mean(label, labels)}", (key, i))
    return labels if wanted is None else wanted


def _crossed(paper: Paper, kind: str, body: Any) -> Iterator[Form]:
    """The cells of a comparison along one list, crossed over the two others."""
    groups = {key: _groups(paper, getattr(body, key)) for key in _SINGULAR}
    along: str | None = getattr(body, "along", None)
    fixed = [key for key in _SINGULAR if key != along]
    for names in product(*([name for group in groups[key] for name in group] for key in fixed)):
        chosen = dict(zip(fixed, names, strict=True))

        def cell(combine: Combination, items: tuple[str, ...], region: Region, **more: Any) -> Form:
            each = [chosen | ({along: item} if along else {}) for item in items]  # noqa: B023
            points = tuple(Point(parse(e["metric"]), parse(e["filters"]), parse(e["cases"])) for e in each)
            selected = _selected(paper, points)
            return Form(
                scenario=body.scenario or paper.scenarios[0],
                text=_words(combine, points, body.statistic),
                estimand=Estimand(combine, points, body.statistic, lost=body.lost, selected=selected, **more),
                region=region,
            )

        if along is None:
            yield cell("value", ("",), _ALL if kind == "show" else _bounds(body))
        else:
            yield from _compared(kind, body, groups[along], cell)


def _compared(kind: str, body: Any, groups: list[list[str]], cell: Callable[..., Form]) -> Iterator[Form]:
    """The cells that compare the items of one list, by kind."""
    items = tuple(name for group in groups for name in group)
    if len(items) < 2:
        raise SpecError("needs at least two to compare", (body.along,))

    def ordered(pair: tuple[str, str], margin: float = 0.0) -> Form:
        """The first is larger than the second."""
        form = cell("difference", pair, Region(margin, inf, open=True), ordered=True, margin=margin)
        plain = form.estimand is not None and all(point.plain for point in form.estimand.points)
        if body.statistic in ("sd", "variance") and plain and not margin:
            return cell("ratio", pair, Region(1.0, inf, open=True))
        return form

    match kind:
        case "ordering":
            for larger, smaller in pairwise(groups):
                for pair in product(larger, smaller):
                    yield ordered(pair, body.margin)
        case "best":
            for other in items[1:]:
                yield ordered((other, items[0]))
        case "trend" | "shape":
            steps = [body.direction] * (len(items) - 1) if kind == "trend" else body.steps
            if len(steps) != len(items) - 1:
                raise SpecError(f"{len(items)} items have {len(items) - 1} steps, not {len(steps)}", ("steps",))
            for (before, after), step in zip(pairwise(items), steps, strict=True):
                yield ordered((after, before) if step == "up" else (before, after))
        case "equal" if len(items) == 2:
            yield cell("relative", items, Region(-body.margin, body.margin))
        case "equal":
            for pair in combinations(items, 2):
                yield cell("ratio", pair, Region(1 / (1 + body.margin), 1 + body.margin))
        case "ratio":
            for other in items[1:]:
                yield cell("ratio", (items[0], other), _bounds(body))
        case "share":
            _single_names(body)
            yield cell("smallest", items, _bounds(body))
        case "slope":
            yield cell("slope", items, _bounds(body), weights=slope_weights(items, body.points))
        case "eigenvalue":
            if not triangle(len(items)):
                raise SpecError(f"{len(items)} entries are no lower triangle of a matrix: 3, 6, 10, ...", (body.along,))
            yield cell("eigenvalue", items, _bounds(body))


def slope_weights(items: tuple[str, ...], points: list[float] | None = None) -> tuple[float, ...]:
    """w_i = (t_i - mean t) / sum (t - mean t)^2, so that sum w_i y_i is the least-squares slope of y over t.

    Without `points`, t are the numbers in the labels (`rate=0.4`).
    """
    if points is None:
        numbers = [re.findall(rf"=({_NUMBER})(?:,|$)", item) for item in items]
        if any(len(each) != 1 for each in numbers):
            raise SpecError("the labels do not hold one number each (`rate=0.4`): give `points`", ("points",))
        points = [float(each[0]) for each in numbers]
    if len(points) != len(items):
        raise SpecError(f"{len(points)} points for {len(items)} items", ("points",))
    centre = sum(points) / len(points)
    spread = sum((t - centre) ** 2 for t in points)
    if spread == 0:
        raise SpecError("the points are all the same", ("points",))
    return tuple((t - centre) / spread for t in points)


def _groups(paper: Paper, written: tuple[tuple[str, ...], ...]) -> list[list[str]]:
    """The list with the paper's named groups written out; a name that stands alone becomes the list itself."""
    expanded = [[each for name in group for each in paper.groups.get(name, [name])] for group in written]
    if len(written) == 1 and len(written[0]) == 1:
        return [[name] for name in expanded[0]]
    return expanded


def _selected(paper: Paper, points: tuple[Point, ...]) -> tuple[tuple[str, Selected], ...]:
    names = dict.fromkeys(name for point in points for name in point.filter.names() if name in paper.select)
    chosen = {name: paper.select[name] for name in names}
    return tuple((name, Selected(tuple(s.filters), s.metric, s.statistic)) for name, s in chosen.items())


def _bounds(body: Any) -> Region:
    return Region(-inf if body.above is None else body.above, inf if body.below is None else body.below)


def _single_names(body: Measurement) -> None:
    for key in _SINGULAR:
        for i, group in enumerate(getattr(body, key)):
            for name in group:
                if parse(name).name is None:
                    raise SpecError(f"shares of runs compare single values, not '{name}'", (key, i))


def _words(combine: Combination, points: tuple[Point, ...], statistic: str) -> str:
    """`hkf - aladkf in err_norm at rate=0.4`: what varies is combined, what is common stands behind."""
    texts = [[_text(getattr(point, part)) for point in points] for part in ("filter", "metric", "case")]
    filter, metric, case = (_join(combine, each) if len(set(each)) > 1 else each[0] for each in texts)
    of = "" if statistic == "mean" else f"{statistic} of "
    return f"{filter} in {of}{metric}" + (f" at {case}" if case else "")


def _join(combine: Combination, texts: list[str]) -> str:
    if combine == "smallest":
        return f"{texts[0]} smallest of {', '.join(texts)}"
    if combine == "eigenvalue":
        return f"least eigenvalue of {triangle(len(texts))} x {triangle(len(texts))} {texts[0]} .. {texts[-1]}"
    if combine == "slope":
        return f"slope over {', '.join(texts)}"
    first, second = (f"({text})" if re.search(r" [-+/*] ", text) else text for text in texts)
    if combine == "relative":
        return f"({first} - {second}) / {second}"
    return f"{first} {'/' if combine == 'ratio' else '-'} {second}"


def _text(expression: Expression) -> str:
    return expression.text.strip()


def _slug(label: str) -> str:
    return re.sub(r"[^a-z0-9.]+", "-", label.lower()).strip("-")
