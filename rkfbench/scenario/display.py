"""The `tables:` and `figures:` of a scenario: what they may say, and which names they use.

A figure or table picks values out of the results by metric, filter, case and reading, and says how they are laid out.
The kinds are few; a paper's figure is one of them with the paper's axes:

    figures:
      - {id: fig1, kind: sweep, over: rate, metric: cond_S, filters: [kf, hkf, aladkf], y: {label: "cond(S)"}}
      - {id: fig3, kind: curve, metric: error_norm, cases: [rate=0.05], y: {unit: m}}
    tables:
      - {id: table1, metric: rmse, rows: case, columns: filter, paper: table-1}
      - {id: table2, metric: "100 * (mse_prior@j - mse@j) / mse_prior@j"}     # arithmetic with statistics, as in claims
      - {id: table3, computed: operation_counts}

A case is named by its label, or by a part of it: `R2` picks `R2,rate=0.2` and `R2,rate=0.4`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, NamedTuple

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, WithJsonSchema, model_validator

from rkfbench.claims.expression import parse
from rkfbench.errors import Path

Dimension = Literal["case", "filter", "metric"]
Statistic = Literal["mean", "median", "sd", "max"]
Computed = Literal["operation_counts", "operation_totals"]  # the functions of report/computed.py
LONGEST_NAME = 100  # of what names files: more is added to it
Name = Annotated[str, Field(min_length=1)]
Names = Name | Annotated[list[Name], Field(min_length=1)]
_LISTED = {"anyOf": [{"type": "string"}, {"type": "array", "minItems": 1, "items": {"minLength": 1, "type": "string"}}]}
Listed = Annotated[  # of names: one alone may be written without brackets, as in claims
    list[Name],
    Field(min_length=1),
    BeforeValidator(lambda value: [value] if isinstance(value, str) else value),
    WithJsonSchema(_LISTED),
]
Identifier = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$",
        max_length=LONGEST_NAME,
        description="names the files: letters, digits, - and _",
    ),
]


class Strict(BaseModel):
    """No unknown keys, no conversion of types, no change after reading."""

    model_config = ConfigDict(defer_build=True, extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class Axis(Strict):
    """How one axis is drawn."""

    label: str = Field(default="", description="text at the axis; default: what is plotted")
    unit: str = Field(default="", description="unit of the values, shown in brackets")
    log: bool | None = Field(
        default=None, description="logarithmic axis; default: when positive values span three decades"
    )
    limits: Annotated[list[float], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="[low, high] of the axis; default: the range of the data"
    )
    times: float = Field(
        default=1.0, gt=0, description="factor on the values, such as 0.5 for seconds from steps of 0.5 s"
    )


class Item(Strict):
    """What every table and figure has."""

    id: Identifier
    title: str = Field(default="", description="one line above; default: the id")
    caption: str = Field(
        default="", description="what the reader should know; runs, reading and cases are added by themselves"
    )
    readings: Listed | None = Field(
        default=None, description="readings, or switches as `reading+switch`; default: all readings"
    )


class Selection(Item):
    """What a table or figure takes out of the results; everything that is left out means all."""

    metric: Names | None
    filters: Listed | None = Field(
        default=None, description="labels of filters, in order; default: all that are not `extra`"
    )
    cases: Listed | None = Field(
        default=None, description="labels of cases or parts of labels, in order; default: all that are not `extra`"
    )

    @property
    def metrics(self) -> list[str]:
        return [self.metric] if isinstance(self.metric, str) else self.metric or []


class Plot(Selection):
    """A figure of panels, one line or mark a filter; a dimension with several values becomes panels by itself."""

    metric: Names = Field(description="metric, or a list of them, as written under `metrics`")
    rows: Dimension | None = Field(default=None, description="what changes from one row of panels to the next")
    columns: Dimension | None = Field(default=None, description="what changes from one column of panels to the next")
    share: Literal["all", "row", "none"] | None = Field(
        default=None,
        description="which panels share their y axis; default: all, or none when the panels show several metrics",
    )
    x: Axis = Field(default=Axis(), description="the horizontal axis")
    y: Axis = Field(default=Axis(), description="the vertical axis")


class Steps(Plot):
    """What `curve` and `panels` share: a metric against the step k, over the runs or of the first run alone."""

    statistic: Literal["mean", "median", "first"] = Field(
        default="mean",
        description="over the runs, at each step; first: the path of the first run, with the band over all",
    )
    beside: Name | None = Field(default=None, description="a second metric, drawn dotted in the same colour")
    band: Name | None = Field(
        default=None, description="a metric b whose band from -b to b is shaded behind the curves"
    )
    before: Names | None = Field(
        default=None,
        description="for each metric one without a curve, such as the error of the prior: a mark left of the curves",
    )

    @model_validator(mode="after")
    def _one_before_each(self) -> Steps:
        if self.before is not None and (len(self.befores) != len(self.metrics) or self.statistic == "first"):
            raise ValueError("`before` is one metric for each of `metric`, and a mean or median of them")
        return self

    @property
    def befores(self) -> list[str]:
        return [self.before] if isinstance(self.before, str) else self.before or []


class Curve(Steps):
    """A metric against the step k, one line a filter."""

    kind: Literal["curve"]


class Panels(Steps):
    """A matrix of panels, case by filter, each with one curve."""

    kind: Literal["panels"]
    rows: Dimension | None = Field(default="case", description="what changes from one row of panels to the next")
    columns: Dimension | None = Field(
        default="filter", description="what changes from one column of panels to the next"
    )


class Sweep(Plot):
    """A metric against a swept parameter, one line a filter."""

    kind: Literal["sweep"]
    over: Name = Field(
        description="a sweep column (`rate`), or filter and parameter (`hkf.threshold`): "
        "then the filters of that name make the line and the others are horizontal"
    )
    statistic: Literal["mean", "median"] = Field(default="mean", description="over the runs")
    whiskers: Literal["sd"] | None = Field(default=None, description="thin bars of one standard deviation of the runs")


class Runs(Plot):
    """One mark a run and filter."""

    kind: Literal["runs"]
    first: int = Field(default=50, ge=1, description="how many runs are shown")


class Bars(Plot):
    """One bar a filter, in groups by case."""

    kind: Literal["bars"]
    statistic: Literal["mean", "median"] = Field(default="mean", description="over the runs")
    paper: Name | None = Field(default=None, description="a printed table of the paper whose numbers are marked")


class Influence(Item):
    """The influence of one measurement: x+ - x- of one update of a scalar state, y = x + v, against the innovation.

    A function of the filters as the scenario describes them; no result enters.
    """

    kind: Literal["influence"]
    filters: Annotated[list[Name], Field(min_length=1)] = Field(description="labels of filters, in order")
    prior: float = Field(default=1.0, gt=0, description="variance P- of the prediction")
    noise: float = Field(default=1.0, gt=0, description="variance R of the measurement")
    largest: float = Field(default=10.0, gt=0, description="innovations from -largest to largest are drawn")
    x: Axis = Field(default=Axis(), description="the horizontal axis")
    y: Axis = Field(default=Axis(), description="the vertical axis")
    rows: None = None
    columns: None = None
    share: None = None


class Forest(Item):
    """Claims as intervals against their claimed regions."""

    kind: Literal["forest"]
    claims: Annotated[list[Name], Field(min_length=1)] | None = Field(
        default=None, description="ids of claims; default: the headline of the paper"
    )


Figure = Annotated[Curve | Panels | Sweep | Runs | Bars | Influence | Forest, Field(discriminator="kind")]


class Table(Selection):
    """A table of one statistic or several, ours with standard error and the paper's number beneath.

    With `paper` alone it has the rows, columns and headings of the printed table; with `computed` it shows no results,
    but what follows from formulas.
    """

    metric: Names | None = Field(
        default=None,
        description="metric, arithmetic such as `100 * (a - b) / a` with the statistics of metrics, or a list; "
        "default: those of the printed table",
    )
    rows: Dimension | list[Dimension] | None = Field(
        default=None, description="what changes from row to row, outermost first; default: case"
    )
    columns: Dimension | list[Dimension] | None = Field(
        default=None, description="what changes from column to column; default: filter"
    )
    statistic: Statistic | list[Statistic] = Field(
        default="mean", description="over the runs; several stand below each other"
    )
    unit: str = Field(default="", description="unit of the values")
    paper: Name | None = Field(default=None, description="the printed table of the paper that this one repeats")
    computed: Computed | None = Field(
        default=None, description="exact counts instead of results; only `title` and `caption` go with it"
    )

    @model_validator(mode="after")
    def _says_what(self) -> Table:
        if self.computed is not None:
            if others := self.model_fields_set - {"computed", "id", "title", "caption"}:
                raise ValueError(f"`{min(others)}` does not go with `computed`, which shows no results")
            return self
        if self.paper is None and self.metric is None:
            raise ValueError("needs `metric`, or `paper` to take everything from a printed table, or `computed`")
        if self.metric is None and (self.rows or self.columns):
            raise ValueError("`rows` and `columns` go with `metric`; without it the printed table gives the layout")
        return self

    @property
    def statistics(self) -> list[str]:
        return [self.statistic] if isinstance(self.statistic, str) else list(self.statistic)


NameKind = Literal["metric", "filter", "case", "reading", "claim", "printed", "over"]


class NameUse(NamedTuple):
    """A name that must exist in the scenario, or in its paper file for `claim` and `printed`, and where it stands."""

    kind: NameKind
    name: str
    path: Path


NAMING: tuple[tuple[NameKind, str], ...] = (
    ("metric", "metric"),
    ("metric", "beside"),
    ("metric", "band"),
    ("metric", "before"),
    ("filter", "filters"),
    ("case", "cases"),
    ("reading", "readings"),
    ("claim", "claims"),
    ("printed", "paper"),
    ("over", "over"),
)  # kind of name and the field that holds it


def names_used(item: Figure | Table) -> Iterator[NameUse]:
    """Every name that a table or figure uses, for the check that the scenario has it."""
    for kind, key in NAMING:
        value = getattr(item, key, None)
        single = metrics_in if kind == "metric" and isinstance(item, Table) else lambda name: (name,)
        if isinstance(value, str):
            yield from (NameUse(kind, name, (key,)) for name in single(value))
        elif value:
            yield from (NameUse(kind, name, (key, i)) for i, each in enumerate(value) for name in single(each))


def metrics_in(metric: str) -> tuple[str, ...]:
    """The metrics of arithmetic over metrics; a metric alone is the only one."""
    try:
        return parse(metric).names()
    except ValueError:  # a metric may hold what reads as a parenthesis too many
        return (metric,)


def case_matches(name: str, label: str) -> bool:
    """Whether `name` in a table or figure picks the cell labelled `label`: all its parts stand in the label."""
    return set(name.split(",")) <= set(label.split(","))
