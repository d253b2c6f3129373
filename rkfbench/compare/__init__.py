"""Two results folders side by side: the same bytes, the same numbers to a tolerance, or a statistical difference.

The same to the tolerance are all cells of all tables, runs.csv apart. Else chance is asked, with one Bonferroni
threshold of a 95 % family for all tests that are made:

- runs that failed, and runs that were lost, of each filter in each case: McNemar's test where the runs are paired
  (both folders keep them, and the seeds agree), else Fisher's;
- the mean of each row of summary.csv: t of the paired differences, else t with the pooled variance, corrected for the
  skewness that the extremes of the row allow;
- its middle, which infinite values and heavy tails leave alone: the sign test of the pairs; else how many runs lie
  beside the other folder's median; where neither keeps its runs, whether quantiles of summary.csv have changed places;
- its infinite values, where both folders keep their runs, in the same way as runs that failed;
- the mean of each step of a curve in series.csv, pooled as above.

Runs that failed are in no pair of values; quantiles of summary.csv count them as +inf. Medians of curves and paths of
single runs are not tested. An exact check, which has no chance in it, differs when it crosses its own tolerance. Rows
that only one folder has are differences, unless it alone was run with extras and switches (--full).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Literal

from rkfbench.compare import chance
from rkfbench.compare.pair import Difference, Key, Pair
from rkfbench.compare.tested import counts, curves, summaries
from rkfbench.store.results import RUNS, Results

FAMILY_ERROR = 0.05
TABLES = ("summary.csv", "series.csv", "filters.csv", "runs.csv", "checks.csv")

Level = Literal["same bytes", "same to the tolerance", "no statistical difference", "different"]


@dataclass(frozen=True)
class Comparison:
    """What two folders have in common: the level, the number of rows compared, and the differences that decide."""

    level: Level
    rows: int
    threshold: float = math.inf
    differences: list[Difference] = field(default_factory=list)
    more: list[Difference] = field(default_factory=list)  # what one of them has because it alone was run in full


def compare(a: Results, b: Results, common: bool = False) -> Comparison:
    """The strongest level on which two results agree; with `common`, what only one of them has does not count."""
    pair = Pair(a, b)
    if _same_bytes(a, b, common):
        return Comparison("same bytes", len(pair.first))
    alone = [] if common else [*pair.alone()]
    more = [each for each in alone if pair.is_extra(each)]
    certain = [*pair.crossed(), *(each for each in alone if not pair.is_extra(each))]
    if not certain and pair.close():
        return Comparison("same to the tolerance", len(pair.rows), more=more)
    tests = [*counts(pair), *summaries(pair)]
    steps = [*curves(pair)]
    threshold = chance.threshold(len(tests) + sum(each.tests for each in steps), FAMILY_ERROR)
    tested = tests + [each.worst for each in steps if each.worst is not None]
    differences = certain + _largest(each for each in tested if abs(each.z) > threshold)
    level: Level = "different" if differences else "no statistical difference"
    return Comparison(level, len(pair.rows), threshold, differences, more)


def _same_bytes(a: Results, b: Results, common: bool) -> bool:
    """Whether the tables that both folders keep are equal; only runs.csv may be one folder's alone (a reference has
    none), or any table with `common`.
    """
    first, second = ({name: each.manifest["files"].get(name) for name in TABLES} for each in (a, b))
    missing = {name for name in TABLES if (first[name] is None) != (second[name] is None)}
    return (common or missing <= {RUNS}) and all(first[name] == second[name] for name in TABLES if name not in missing)


def _largest(differences: Iterable[Difference]) -> list[Difference]:
    """Of each row the difference that tells most."""
    found: dict[Key, Difference] = {}
    for each in differences:
        if each.key not in found or abs(each.z) > abs(found[each.key].z):
            found[each.key] = each
    return list(found.values())
