"""What a scenario file may say: the keys, their types and their meaning.

`Experiment` is what one cell of a study needs and what a reading, case or sweep may override; `ScenarioFile` adds what
spans the cells. Where the allowed keys come from a catalogue (models, laws, filters, metrics), the schema takes any
plain data and `check.py` asks the catalogue; `json_schema.py` writes the catalogue into the JSON Schema.
"""

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Discriminator, Field, Tag

from rkfbench.scenario.claims import Claim
from rkfbench.scenario.display import LONGEST_NAME, Figure, Strict, Table

CONTROL = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029]")


def fault_of(name: str) -> str:
    """What is wrong with a name that is to stand in the tables of the results: what would tear a line apart."""
    return "a name holds no line breaks and other control characters" if CONTROL.search(name) else ""


def _named(name: str) -> str:
    if fault := fault_of(name):
        raise ValueError(fault)
    return name


def _reading(name: str) -> str:
    if "+" in name:
        raise ValueError("the name of a reading holds no `+`, which stands before a switch: `reading+switch`")
    return _named(name)


MOST_STEPS = 1_000_000
MOST_RUNS = 10_000_000
SEEDS = 2**63  # so many; whole numbers of 20 digits and more are not read back as such

Vector = Annotated[list[float], Field(min_length=1)]
Text = Annotated[str, Field(min_length=1)]
Named = Annotated[str, AfterValidator(_named)]
FolderName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=LONGEST_NAME)]
Matrix = Annotated[
    Any, Field(description="a number (times I), a list (diagonal), rows, or an operation such as {matrix_root_of: M}")
]
Overrides = Annotated[dict[str, Any], Field(description="dotted path: value; the value replaces the whole node")]
Scalar = Annotated[float, Tag("number")] | Annotated[bool, Tag("flag")] | Annotated[str, Tag("text")]
Point = Annotated[Scalar, Discriminator(lambda value: {bool: "flag", str: "text"}.get(type(value), "number"))]


class Drawn(Strict):
    """A true initial state drawn from N(mean, cov) for each run."""

    mean: Vector = Field(description="mean of the true initial state")
    cov: Matrix


class Start(Strict):
    """The true state at k = 0."""

    truth: Annotated[
        Annotated[Vector, Tag("fixed")] | Annotated[Drawn, Tag("drawn")],
        Discriminator(lambda value: "drawn" if isinstance(value, (dict, Drawn)) else "fixed"),
    ] = Field(description="the state itself, or {mean, cov} to draw it for each run")


class Input(Strict):
    """A known constant input of the model."""

    value: float = Field(description="value of the input")
    filters_use_it: bool = Field(default=True, description="whether the filters know it, as the truth does")


class FilterAssumed(Strict):
    """What one filter is told instead of what `assumed` tells all of them."""

    mean: Vector | None = Field(default=None, description="initial state estimate")
    cov: Matrix = None
    process_cov: Matrix = Field(default=None, description="Q: a matrix, or the name of a covariance the law knows")
    measurement_cov: Matrix = Field(default=None, description="R: a matrix, or the name of a covariance the law knows")


class Assumed(Strict):
    """What the filters are told; what is simulated is said elsewhere."""

    mean: Vector = Field(description="initial state estimate (posterior at k = 0)")
    mean_drawn: bool = Field(default=False, description="draw the initial estimate of each run from N(mean, cov)")
    cov: Matrix = Field(description="P0, covariance of the initial estimate")
    process_cov: Matrix = Field(
        default="law", description="Q: a matrix, `law` (covariance of the process noise) or a named part of the law"
    )
    measurement_cov: Matrix = Field(
        default="law", description="R: a matrix, `law` (covariance of the noise) or a named part such as `body`"
    )


class Data(Strict):
    """Recorded data in place of a simulation: CSV files, their paths as seen from the scenario file."""

    measurements: Text = Field(
        description="one row a step, the measurements as columns, `run` where there are several; empty: missing"
    )
    truth: Text | None = Field(default=None, description="the same rows with the states as columns, where known")
    time: Text | None = Field(default=None, description="column of the time; without it the steps are the model's")


class Lost(Strict):
    """When a run counts as lost: the error of some state exceeds a limit."""

    states: list[Text] = Field(min_length=1, description="names of the states looked at")
    limit: float = Field(gt=0, description="absolute error beyond which the run is lost")
    after: int | None = Field(default=None, ge=0, description="look at the steps k > after")
    at: int | None = Field(default=None, ge=1, description="look at this step only")
    window: Annotated[list[int], Field(min_length=2, max_length=2)] | None = Field(
        default=None, description="look at the steps first..last"
    )
    statistic: Literal["max", "rms"] = Field(default="max", description="largest error over the steps, or its RMS")


class PointOfTime(Strict):
    """The step whose state point smoothers estimate; in a metric `@j` means this step."""

    at: int = Field(ge=1, description="the step j")
    lag: int = Field(ge=0, description="measurements after j that smoothers use")


class Reading(Strict):
    """A way to read the paper: `dotted path: value` as in all overrides, and what must be said of it."""

    model_config = ConfigDict(extra="allow")

    caveat: Text | None = Field(
        default=None, description="what is said wherever the reading is shown: captions, tables, ledger, report"
    )


class Runs(Strict):
    """Numbers of Monte Carlo runs."""

    paper: int = Field(default=100, ge=1, le=MOST_RUNS, description="the paper's own number, used by `run`")
    reference: int = Field(default=1000, ge=1, le=MOST_RUNS, description="the number on which verdicts rest")


class Citation(Strict):
    """Where an experiment comes from, when there is no paper file."""

    cite: Text = Field(description="journal, volume, pages")
    doi: str = Field(default="", description="digital object identifier")


class Range(Strict):
    """Equally spaced values, both ends included."""

    from_: float = Field(alias="from", description="first value")
    to: float = Field(description="last value")
    step: float = Field(gt=0, description="distance")


def _points_form(value: Any) -> str:
    if isinstance(value, dict):
        return "range" if {"from", "to", "step"} & set(value) else "labelled"
    return "range" if isinstance(value, Range) else "list"


Points = Annotated[
    Annotated[list[Point], Field(min_length=1), Tag("list")]
    | Annotated[Range, Tag("range")]
    | Annotated[dict[str, Any], Field(min_length=1), Tag("labelled")],
    Discriminator(_points_form),
]


class Tiers(Strict):
    """Values of a sweep in two tiers."""

    values: Points = Field(description="a list, {from, to, step}, or label: value where a value is not a single word")
    extra: Points | None = Field(default=None, description="further values for the full study only")


def _sweep_form(value: Any) -> str:
    if isinstance(value, Tiers) or (isinstance(value, dict) and {"values", "extra"} & set(value)):
        return "tiers"
    return "points"


Sweep = Annotated[Annotated[Tiers, Tag("tiers")] | Annotated[Points, Tag("points")], Discriminator(_sweep_form)]


class Experiment(Strict):
    """One cell: a model, its noise, what the filters are told, the filters, what is measured."""

    steps: int | None = Field(
        default=None, ge=1, le=MOST_STEPS, description="number of steps T; k = 1..T; with data: default all"
    )
    data: Data | None = Field(default=None, description="recorded data in place of a simulation")
    model: Any = Field(description="state-space model: {kind, parameters}")
    truth: Any = Field(default="model", description="`model`, or a scripted trajectory {kind, parameters}")
    start: Start | None = None
    input: Input | None = Field(default=None, description="known input of the model")
    process_noise: Any = Field(default=None, description="law of w_k; none if left out")
    measurement_noise: Any = Field(default=None, description="law of the measurement noise: {kind, parameters}")
    disturbances: list[Any] = Field(default=[], description="shots and scripted errors, on top of the noise")
    assumed: Assumed
    lost: Lost | None = None
    point: PointOfTime | None = Field(default=None, description="what point smoothers estimate")
    score: Text | None = Field(default=None, description="what the metric `score` means here; default: `rmse`")
    filters: list[Any] = Field(min_length=1, description="names, or {use: name, parameters, label, extra, assumed}")
    metrics: list[Annotated[Text, AfterValidator(_named)]] = Field(
        min_length=1, description="such as `rmse`, `rmse[px]`, `mse[px]@900`, or `err_norm@k` for the curve over k"
    )


META = ("name", "title", "paper", "notes", "names", "seed", "runs")


class ScenarioFile(Experiment):
    """One scenario file."""

    name: FolderName = Field(description="names the results folder")
    title: str = Field(default="", description="one line")
    paper: (
        Annotated[
            Annotated[Text, Tag("name")] | Annotated[Citation, Tag("citation")],
            Discriminator(lambda value: "citation" if isinstance(value, (dict, Citation)) else "name"),
        ]
        | None
    ) = Field(default=None, description="name of a file in scenarios/papers, or {cite, doi}")
    notes: str = Field(default="", description="free text for the reader")
    names: dict[str, Text] = Field(
        default={},
        description="label of a case, sweep column, point (`rate=0.1`), filter or metric: what readers see",
    )
    seed: int = Field(default=0, ge=0, lt=SEEDS, description="seed of all random streams")
    runs: Runs = Field(default=Runs(), description="numbers of Monte Carlo runs")
    plugins: Text | None = Field(
        default=None, description="folder of own filters, models ... that are files; default: that of this file"
    )
    readings: dict[Annotated[str, AfterValidator(_reading)], Reading] = Field(
        default={},
        description="ways to read the paper, dotted path: value; the first is the headline. `caveat: text` is said "
        "wherever a reading is shown; a scenario without readings has one that is called `default`",
    )
    sensitivity: dict[Named, Overrides] = Field(default={}, description="switches changed one at a time")
    cases: dict[Annotated[str, Field(pattern="^[^,=]+$"), AfterValidator(_named)], Overrides] = Field(
        default={}, description="experimental conditions; `extra: true` for the full study only"
    )
    sweep: dict[str, Sweep] = Field(default={}, description="dotted path: values; several are crossed")
    tables: list[Table] = Field(default=[], description="tables to write")
    figures: list[Figure] = Field(default=[], description="figures to draw")
    claims: list[Claim] = Field(default=[], description="your own claims; those of a paper stand in its file")
