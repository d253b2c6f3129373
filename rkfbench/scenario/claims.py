"""How a claim is written: what is measured, the region claimed for it, and its place in the paper.

    claims:
      - id: C3d                                 # in a paper's file; a user's own claims stand in the scenario
        locator: "abstract; Fig. 5, 6"
        says: at high contamination the ALADKF is clearly better than the HKF
        evidence: text
        ordering: {metric: err_norm, filters: [hkf, aladkf], cases: [rate=0.3, rate=0.4]}

Each claim has one deciding measurement of some kind, if need be more under `also`, and others under `beside` that are
shown and decide nothing. Every kind picks `metric`, `filters` and `cases`; those that it does not compare are crossed,
and each combination is a cell with a verdict of its own; the claim holds if all cells do. Three things hold everywhere:

- A list runs from the largest to the smallest: `filters: [ekf, ukf, pekf]` claims EKF > UKF > PEKF. A list within the
  list is a group: `[kf, [hkf, aladkf]]` claims KF > HKF and KF > ALADKF.
- An item may be arithmetic, with spaces around the operators: `hkf - aladkf`, `rate=0.05 / rate=0`, `0.5 * ekf - pekf`.
- `along` says which of `filters`, `cases`, `metric` is compared.

Names are labels of the scenario, or of a group or selection in the paper's file. The metric `lost` is 1 for a lost run
(so its mean is the share of lost runs), `failed` likewise; `time_ms` and `time_ns` are clock values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema, model_validator

from rkfbench.claims.expression import parse
from rkfbench.errors import Path
from rkfbench.scenario.display import NameUse, Strict

Along = Literal["filters", "cases", "metric"]
Statistic = Literal["mean", "median", "sd", "variance", "rms"]
Evidence = Literal["text", "literature", "reconstruction", "ours"]
Role = Literal["decides", "beside"]
Items = tuple[tuple[str, ...], ...]  # groups of names; a plain name is a group of one


def _items(value: object) -> Items:
    """A name, a list of names, or a list with lists of names, as groups."""
    listed = [value] if isinstance(value, str) else value
    if not isinstance(listed, Sequence) or not listed:
        raise ValueError("must be a name or a list of names (in which a list is a group)")
    groups = []
    for item in listed:
        group = [item] if isinstance(item, str) else item
        if not isinstance(group, Sequence) or not group or not all(isinstance(name, str) for name in group):
            raise ValueError(f"must be a name or a list of names, not {item!r}")
        for name in group:
            parse(name)
        groups.append(tuple(group))
    return tuple(groups)


_ITEMS_SCHEMA = {
    "anyOf": [
        {"type": "string"},
        {
            "type": "array",
            "minItems": 1,
            "items": {"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}]},
        },
    ]
}
Picked = Annotated[Items, BeforeValidator(_items), WithJsonSchema(_ITEMS_SCHEMA)]


class Measurement(Strict):
    """What every measured kind says: what is looked at, and where."""

    metric: Picked = Field(description="metric, or a list: each is a cell of its own")
    filters: Picked = Field(description="labels of filters; a list within the list is a group")
    cases: Picked = Field(default=(("",),), description="labels of cases; left out where the scenario has only one")
    readings: list[str] | None = Field(default=None, min_length=1, description="readings it holds under; default: all")
    scenario: str | None = Field(default=None, description="the paper's scenario it draws on; default: the first")
    statistic: Statistic = Field(
        default="mean", description="over the runs, before any arithmetic; rms: root of the mean square (pooled error)"
    )
    lost: Literal["largest", "smallest"] = Field(
        "largest", description="what a lost run counts as where runs are compared one by one"
    )


class Ordering(Measurement):
    """Paired differences of neighbours in the list > 0 (largest first)."""

    along: Along = Field(default="filters", description="which list is compared")
    margin: float = Field(default=0.0, description="by how much at least, in the units of the metric")


class Best(Measurement):
    """The first is smaller than each of the others: all differences other - first > 0."""

    along: Along = Field(default="filters", description="which list is compared")


class Equal(Measurement):
    """Two items: (first - second)/second within +- margin. More: largest/smallest at most 1 + margin, pair by pair."""

    along: Along = Field(default="filters", description="which list is compared")
    margin: float = Field(gt=0, description="largest relative difference, 0.05 for 5 %")


class Trend(Measurement):
    """All increments from one item to the next > 0, or < 0 for `direction: down`."""

    along: Along = Field(default="cases", description="along which list it grows")
    direction: Literal["up", "down"] = Field(default="up", description="growing or falling")


class Shape(Measurement):
    """The signs of the increments along a list, such as down, down, up for a valley."""

    along: Along = Field(default="cases", description="along which list")
    steps: list[Literal["up", "down"]] = Field(min_length=1, description="one for each step from item to item")


class _Bounded(Measurement):
    """A region from `above` to `below`, edges included; one of them may be left out."""

    above: float | None = Field(default=None, description="at least this")
    below: float | None = Field(default=None, description="at most this")

    @model_validator(mode="after")
    def _has_a_region(self) -> _Bounded:
        if self.above is None and self.below is None:
            raise ValueError("needs `above`, `below` or both")
        if self.above is not None and self.below is not None and self.above >= self.below:
            raise ValueError("`above` must be smaller than `below`")
        return self


class Bound(_Bounded):
    """The number itself lies between `above` and `below`."""


class Ratio(_Bounded):
    """The first divided by each of the others lies between `above` and `below`."""

    along: Along = Field(default="filters", description="which list is compared")


class Share(_Bounded):
    """The share of runs in which the first is the smallest of all (a tie counts one half)."""

    along: Along = Field(default="filters", description="which list is compared")
    above: float | None = Field(default=0.5, ge=0, le=1, description="at least this share of the runs")
    below: float | None = Field(default=None, ge=0, le=1, description="at most this share of the runs")


class Slope(_Bounded):
    """The least-squares slope over a swept number."""

    along: Along = Field(default="cases", description="along which list")
    points: list[float] | None = Field(
        default=None, min_length=2, description="the abscissae; default: the numbers in the case labels (`rate=0.4`)"
    )


class Eigenvalue(_Bounded):
    """The least eigenvalue of a symmetric matrix of such numbers: its lower triangle, row by row."""

    along: Along = Field(default="metric", description="along which list")


class Show(Measurement):
    """The number with its interval, no region: only `beside`."""


class Value(Strict):
    """Cells of a printed table of the paper against ours, by replication intervals."""

    table: str = Field(description="key of the table under `tables`")
    rows: list[str] | None = Field(default=None, min_length=1, description="labels of rows; default: all")
    columns: list[str] | None = Field(default=None, min_length=1, description="labels of columns; default: all")
    readings: list[str] | None = Field(default=None, min_length=1, description="readings it holds under; default: all")


class Exact(Strict):
    """Registered checks without chance: the deviation of each stays within its tolerance."""

    check: str | list[str] = Field(description="id of a check, or a list")
    scenario: str | None = Field(default=None, description="the scenario that runs it; default: the first")

    @property
    def checks(self) -> list[str]:
        """The ids, as a list."""
        return [self.check] if isinstance(self.check, str) else self.check


class Undecided(Strict):
    """Why nothing can be measured, with the place in the text."""

    reason: str = Field(min_length=1, description="what is missing, and where one would expect it")


KINDS = (
    *("ordering", "best", "equal", "trend", "shape", "bound", "ratio", "share", "slope"),
    *("eigenvalue", "show"),
    *("value", "exact", "unsupported", "not_testable"),
)


class Part(Strict):
    """Exactly one measurement, under the name of its kind."""

    ordering: Ordering | None = Field(default=None, description="larger than the next, one after the other")
    best: Best | None = Field(default=None, description="the first is the smallest")
    equal: Equal | None = Field(default=None, description="about the same, within a relative margin")
    trend: Trend | None = Field(default=None, description="grows or falls along the cases")
    shape: Shape | None = Field(default=None, description="a pattern of ups and downs")
    bound: Bound | None = Field(default=None, description="a number within bounds")
    ratio: Ratio | None = Field(default=None, description="the first over each of the others, within bounds")
    share: Share | None = Field(default=None, description="in how many runs the first is the smallest")
    slope: Slope | None = Field(default=None, description="slope over a swept number, within bounds")
    eigenvalue: Eigenvalue | None = Field(
        default=None, description="least eigenvalue of a symmetric matrix, within bounds"
    )
    show: Show | None = Field(default=None, description="a number without a region (only `beside`)")
    value: Value | None = Field(default=None, description="printed numbers of the paper")
    exact: Exact | None = Field(default=None, description="checks of algebra, theorems, counts")
    unsupported: Undecided | None = Field(default=None, description="said to be proved, without a proof")
    not_testable: Undecided | None = Field(default=None, description="the text lacks what a test needs")

    @model_validator(mode="after")
    def _one_kind(self) -> Part:
        given = [kind for kind in KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            has = f"; has {', '.join(given)}" if given else ""
            raise ValueError(f"needs exactly one of {', '.join(KINDS)}{has}")
        return self

    @property
    def kind(self) -> str:
        """The name of the kind that is given."""
        return next(kind for kind in KINDS if getattr(self, kind) is not None)

    @property
    def body(self) -> Any:
        """What is given under it: a Measurement, Value, Exact or Undecided."""
        return getattr(self, self.kind)


class Claim(Part):
    """A statement of a paper, or the user's own, that the runs decide."""

    id: str = Field(
        pattern=r"^[A-Za-z0-9{][A-Za-z0-9_.{}-]*$",
        description="short and unique; {row} or {column} in it makes one claim for each row or column of its table",
    )
    locator: str = Field(default="", description="where the paper says it")
    says: str = Field(min_length=1, description="what it says, in one line")
    evidence: Evidence = Field(default="text", description="text: said in the paper; ours: our own question; ...")
    extra: bool = Field(default=False, description="needs the extra tier; judged as a family of its own")
    holds: Literal["all", "any"] = Field(
        default="all", description="whether it holds if all of its cells do, or if any one of them does"
    )
    also: list[Part] = Field(default=[], description="further measurements that must hold too")
    beside: list[Part] = Field(default=[], description="measurements that are shown and decide nothing")

    @model_validator(mode="after")
    def _show_decides_nothing(self) -> Claim:
        if any(part.kind == "show" for part in (self, *self.also)):
            raise ValueError("`show` has no region: put it under `beside`, and `not_testable` in its place")
        return self

    def parts(self) -> Iterator[tuple[Path, Role, Part]]:
        """(path within the claim, "decides" or "beside", part) of every measurement."""
        yield (), "decides", self
        for i, part in enumerate(self.also):
            yield ("also", i), "decides", part
        for i, part in enumerate(self.beside):
            yield ("beside", i), "beside", part


def names_used(claim: Claim) -> Iterator[tuple[str | None, NameUse]]:
    """(scenario, use) of every metric, filter, case and reading of a claim, for the check that the scenario has it.

    The scenario is None where the measurement names none; the path is that within the claim. Groups and selections of
    a paper are among the names.
    """
    for path, _, part in claim.parts():
        body = part.body
        scenario = getattr(body, "scenario", None)
        for i, reading in enumerate(getattr(body, "readings", None) or ()):
            yield scenario, NameUse("reading", reading, (*path, part.kind, "readings", i))
        if not isinstance(body, Measurement):
            continue
        for kind, key in (("metric", "metric"), ("filter", "filters"), ("case", "cases")):
            written: Items = getattr(body, key)
            for i, group in enumerate(written):
                place = (*path, part.kind, key, i) if len(written) > 1 else (*path, part.kind, key)
                for name in dict.fromkeys(name for item in group for name in parse(item).names()):
                    yield scenario, NameUse(kind, name, place)  # type: ignore[arg-type]
