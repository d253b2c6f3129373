"""claims.csv: one line a cell, with all that its verdict was computed from, and judging stored lines again.

A record is a mapping of plain values as `store` reads and writes them; None is an empty field. What is read back is
what was computed, to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, isnan, nan
from typing import Any

from rkfbench.claims.ledger import Row, family_of, judged
from rkfbench.claims.measure import Observation
from rkfbench.claims.plan import Cell, Outlines
from rkfbench.claims.verdict import Measured, Printed
from rkfbench.errors import UsageError
from rkfbench.scenario.paper_schema import Paper

KEY = ("claim", "role", "kind", "estimand", "scenario", "reading")
_OBSERVED = ("decided_on", "mean", "median", "failed", "lost", "chosen")
_MEASURED = ("estimate", "se", "runs", "law", "ties", "scale")
_TERMS = "terms"  # of a sum of shares, as text
_JUDGED = ("c", "lower", "upper", "verdict", "flip_at", "flip", "flip_percent", "runs_needed", "resolution", "reason")
COLUMNS = (
    *KEY,
    *("evidence", "family", "family_size", "claimed", "region_low", "region_high", "region_open", "printed"),
    *("printed_runs", "printed_rounding"),
    *_MEASURED,
    _TERMS,
    "floor",
    *_OBSERVED,
    *_JUDGED,
    *("paper_runs", "at_paper_runs"),
)


@dataclass(frozen=True)
class Stored:
    """What a line of claims.csv keeps of a cell."""

    key: tuple[str, ...]
    observed: Observation | None
    verdict: str
    paper_runs: int


def record(row: Row) -> dict[str, object]:
    """The line of a row, by column: text, numbers, and None for what there is not."""
    cell, form, observed = row.cell, row.cell.form, row.observed
    region, printed = row.region, form.printed or Printed(nan, 0)
    bounded = (region.low, region.high) != (-inf, inf)
    values: dict[str, object] = dict(zip(KEY, cell.key, strict=True)) | {
        "evidence": cell.claim.evidence,
        "family": cell.family,
        "family_size": row.family_size,
        "claimed": str(region) if bounded else "",
        "region_low": region.low,
        "region_high": region.high,
        "region_open": str(region.open).lower(),
        "printed": printed.value,
        "printed_runs": printed.runs or None,
        "printed_rounding": printed.rounding if printed.runs else nan,
        "paper_runs": row.paper_runs,
        "at_paper_runs": row.at_paper_runs,
    }
    if observed is not None:
        values |= {name: getattr(observed, name) for name in _OBSERVED}
        values |= {name: getattr(observed.measured, name) for name in (*_MEASURED, "floor")}
        values[_TERMS] = " ".join(f"{value!r}:{count}" for value, count in observed.measured.terms)
    values |= {name: getattr(row.judgement, name) for name in _JUDGED}
    return {name: None if _missing(value := values.get(name)) else value for name in COLUMNS}


def stored(line: Mapping[str, Any]) -> Stored:
    """What a line of claims.csv keeps. Raises UsageError if it is not such a line."""
    missing = [name for name in COLUMNS if name not in line]
    if missing:
        raise UsageError(f"not a line of claims.csv of this version: no {', '.join(missing)}")
    try:
        observed = None
        if line["runs"] is not None:
            estimate, se, scale = (_number(line[name]) for name in ("estimate", "se", "scale"))
            pairs = (term.split(":") for term in _text(line[_TERMS]).split())
            terms = tuple((float(value), int(count)) for value, count in pairs)
            runs, ties, floor = int(line["runs"]), int(line["ties"]), _number(line["floor"])
            measured = Measured(estimate, se, runs, line["law"], ties, scale, terms, floor)
            mean, median = _number(line["mean"]), _number(line["median"])
            counted = int(line["failed"]), int(line["lost"])
            observed = Observation(measured, line["decided_on"], mean, median, *counted, _text(line["chosen"]))
        key = tuple(_text(line[name]) for name in KEY)
        return Stored(key, observed, _text(line["verdict"]), int(line["paper_runs"]))
    except (TypeError, ValueError) as error:
        raise UsageError(f"claims.csv: claim {line['claim']}: {error}") from error


@dataclass(frozen=True)
class Change:
    """A cell whose verdict is not the stored one; `before` is empty for a new cell, `now` for one that has gone.

    What only stands beside, or was measured with a clock, does not `matter`: it decides no exit code.
    """

    key: tuple[str, ...]
    before: str
    now: str
    row: Row | None

    @property
    def matters(self) -> bool:
        """Whether the difference is one of a verdict that counts."""
        return self.key[1] == "decides" and (self.row is None or self.row.cell.family != "timing")


def verify(
    paper: Paper, cells: Sequence[Cell], lines: Iterable[Stored], outlines: Outlines
) -> tuple[tuple[Row, ...], tuple[Change, ...]]:
    """The current claims judged on stored measurements: all rows, and the cells whose verdict changed.

    A cell that has no stored line cannot be judged without the values of single runs: `not run`.
    """
    size = family_of(paper, cells, outlines)
    before = {line.key: line for line in lines}
    rows, changes = [], []
    for cell in cells:
        kept = before.get(cell.key)
        paper_runs = kept.paper_runs if kept else outlines[cell.form.scenario].paper_runs
        row = judged(cell, kept.observed if kept else None, size(cell), paper_runs)
        rows.append(row)
        if kept is None or kept.verdict != row.verdict:
            changes.append(Change(cell.key, kept.verdict if kept else "", row.verdict, row))
    known = {cell.key for cell in cells}
    gone = (Change(key, line.verdict, "", None) for key, line in before.items() if key not in known)
    return tuple(rows), (*changes, *gone)


def _missing(value: object) -> bool:
    return value is None or value == "" or (isinstance(value, float) and isnan(value))


def _text(value: Any) -> str:
    return "" if value is None else str(value)


def _number(value: Any) -> float:
    return nan if value is None else float(value)
