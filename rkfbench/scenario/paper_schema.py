"""What a paper's file may say: citation, printed tables, claims, and the frozen size of its family of verdicts.

    scenarios/papers/NAME.yaml

A printed number stands once, in a table; table, row and column together say which filter, case, metric and statistic
it is, so that claims of kind `value` and the tables of the report find our number for it.
"""

from __future__ import annotations

from pydantic import Field, model_validator

from rkfbench.scenario.claims import Claim, Statistic
from rkfbench.scenario.display import Strict


class Names(Strict):
    """Part of what a printed number is; the rest is said by the other two of table, row and column."""

    filter: str | None = Field(default=None, description="the filter it belongs to")
    case: str | None = Field(default=None, description="the case it belongs to")
    metric: str | None = Field(default=None, description="the metric it belongs to")
    statistic: Statistic | None = Field(default=None, description="the statistic over the runs; default: the mean")


class PrintedLine(Names):
    """A column of a printed table: its heading, and what that says of its numbers."""

    label: str = Field(description="the printed heading")


class PrintedRow(PrintedLine):
    """A row with its numbers."""

    values: list[float | None] = Field(description="one for each column; null where nothing is printed")


class PrintedTable(Names):
    """Numbers as the paper prints them."""

    title: str = Field(description="the paper's heading")
    runs: int = Field(ge=1, description="Monte Carlo runs behind each number")
    decimals: int | None = Field(default=None, ge=0, description="printed decimals; half a unit of the last is granted")
    unit: str = Field(default="", description="unit of the numbers")
    scenario: str | None = Field(default=None, description="the paper's scenario it belongs to; default: the first")
    once: bool = Field(default=False, description="each row has one number, which every column reads in its way")
    columns: list[PrintedLine] = Field(min_length=1, description="columns, from left to right")
    rows: list[PrintedRow] = Field(min_length=1, description="rows, from top to bottom")

    @model_validator(mode="after")
    def _is_full(self) -> PrintedTable:
        count, columns = (1, "all") if self.once else (len(self.columns), len(self.columns))
        for row in self.rows:
            if len(row.values) != count:
                raise ValueError(f"row '{row.label}' has {len(row.values)} values for {columns} columns")
        return self

    def numbers(self, row: PrintedRow) -> list[tuple[PrintedLine, float | None]]:
        """The columns with the numbers that a row prints in them."""
        values = row.values * len(self.columns) if self.once else row.values
        return list(zip(self.columns, values, strict=True))

    def cell(self, row: PrintedRow, column: PrintedLine) -> dict[str, str]:
        """{filter, case, metric, statistic} of a cell: what the column says, else the row, else the table."""
        found = {}
        for key, default in (("filter", None), ("case", ""), ("metric", None), ("statistic", "mean")):
            given = [value for line in (column, row, self) if (value := getattr(line, key)) is not None]
            value = given[0] if given else default
            if value is None:
                raise ValueError(f"row '{row.label}', column '{column.label}': neither says which {key} it is")
            found[key] = value
        return found


class BestOf(Strict):
    """The filter that does best on the tuning runs, which have a seed of their own; judged on the test runs."""

    filters: list[str] = Field(min_length=2, alias="from", description="labels of the candidates")
    metric: str = Field(description="the one with the smallest value is taken, in each reading and case")
    statistic: Statistic = Field(default="mean", description="over the tuning runs")


class Paper(Strict):
    """A paper's file: citation, printed tables, claims, and the frozen size of its family of verdicts."""

    cite: str = Field(description="authors, title, journal, volume, pages")
    doi: str | None = Field(default=None, description="digital object identifier")
    title: str = Field(default="", description="short title for tables and headings")
    runs: int | None = Field(default=None, ge=1, description="Monte Carlo runs of the paper")
    scenarios: list[str] = Field(min_length=1, description="its bundled scenarios; the first is the default of claims")
    headline: list[str] = Field(default=[], max_length=6, description="ids of its main claims")
    family: dict[str, int] = Field(default={}, description="number of cells judged together, for each reading; frozen")
    groups: dict[str, list[str]] = Field(default={}, description="names for lists of filters or cases")
    select: dict[str, BestOf] = Field(default={}, description="filters chosen on tuning runs, by name")
    tables: dict[str, PrintedTable] = Field(default={}, description="printed tables")
    claims: list[Claim] = Field(default=[], description="its claims")

    @model_validator(mode="after")
    def _names_fit(self) -> Paper:
        seen: set[str] = set()
        for claim in self.claims:
            if claim.id in seen:
                raise ValueError(f"claims: id '{claim.id}' stands twice")
            seen.add(claim.id)
        for name in self.headline:
            if name not in seen:
                raise ValueError(f"headline: no claim '{name}'")
        return self
