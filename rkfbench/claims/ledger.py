"""The ledger: every cell measured and judged, and one verdict for every claim under every reading."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, nan

from rkfbench.claims.measure import Observation, Stats, observe
from rkfbench.claims.plan import Cell, Family, Outlines, family_sizes
from rkfbench.claims.verdict import Judgement, Measured, Region, Verdict, combine, decisive, judge
from rkfbench.scenario.claims import Claim
from rkfbench.scenario.paper_schema import Paper

WINS = Region(0.5, inf, open=True)  # an ordering with lost runs: the claimed order in more than half of the runs
UNORDERED = "runs were lost, and a formula that is no sum puts no two runs in order"
BY_WORD: dict[str, Verdict] = {"unsupported": "unsupported", "not_testable": "not testable"}


@dataclass(frozen=True)
class Row:
    """One cell with what was observed and how it was judged; `observed` is None where nothing was (not run, no test).

    `at_paper_runs` is the verdict that the same estimate would have got from the paper's own number of runs.
    """

    cell: Cell
    family_size: int
    paper_runs: int
    observed: Observation | None
    region: Region
    judgement: Judgement
    at_paper_runs: Verdict | None = None

    @property
    def verdict(self) -> Verdict:
        """The verdict on the cell."""
        return self.judgement.verdict


@dataclass(frozen=True)
class ClaimVerdict:
    """A claim as a reader sees it: for each reading its verdict, its deciding rows, and the `decisive` one."""

    id: str
    claim: Claim
    headline: bool
    verdicts: Mapping[str, Verdict]
    rows: Mapping[str, tuple[Row, ...]]
    decisive: Mapping[str, Row]

    def under(self, readings: Sequence[str]) -> ClaimVerdict:
        """The same under these readings alone."""
        kept = {reading: verdict for reading, verdict in self.verdicts.items() if reading in readings}
        return replace(self, verdicts=kept)

    @property
    def timing(self) -> bool:
        """Whether it is decided by a clock: true of one machine only, and counted apart."""
        return any(row.cell.family == "timing" for rows in self.rows.values() for row in rows)


def ledger(paper: Paper, cells: Sequence[Cell], stats: Mapping[str, Stats], outlines: Outlines) -> tuple[Row, ...]:
    """Every cell measured and judged, in the order of `cells`. A scenario without stats gives the verdict `not run`."""
    size = family_of(paper, cells, outlines)
    return tuple(
        evaluate(cell, stats.get(cell.form.scenario), size(cell), outlines[cell.form.scenario].paper_runs)
        for cell in cells
    )


def evaluate(cell: Cell, stats: Stats | None, family: int, paper_runs: int) -> Row:
    """One cell measured on the results of its scenario and judged in a family of `family` cells."""
    return judged(cell, _observed(cell, stats), family, paper_runs)


def judged(cell: Cell, observed: Observation | None, family: int, paper_runs: int) -> Row:
    """The row of a cell from what was observed; this alone is repeated when stored results are verified."""
    form = cell.form
    if cell.kind in BY_WORD or observed is None:
        word = BY_WORD.get(cell.kind, "not run")
        judgement = Judgement(word, nan, nan, nan, nan, nan, nan, reason=form.reason)
        return Row(cell, family, paper_runs, observed, form.region, judgement)
    measured = observed.measured
    region = WINS if observed.decided_on == "wins" else form.region
    if form.check:
        region = Region(high=measured.scale)
    if observed.decided_on == "nothing":
        judgement = Judgement("inconclusive", nan, nan, nan, nan, nan, nan, reason=UNORDERED)
        return Row(cell, family, paper_runs, observed, region, judgement)
    judgement = judge(measured, region, family, form.printed)
    if cell.kind == "show":
        shown = replace(judgement, verdict="shown", flip_at=nan, flip=nan, flip_percent=nan, runs_needed=None)
        return Row(cell, family, paper_runs, observed, region, shown)
    seen_by_paper = measured.law != "exact" and measured.runs > 0 and cell.family != "timing"
    there = judge(measured.at(paper_runs), region, family, form.printed).verdict if seen_by_paper else None
    return Row(cell, family, paper_runs, observed, region, judgement, there)


def family_of(paper: Paper, cells: Sequence[Cell], outlines: Outlines) -> Callable[[Cell], int]:
    """For each cell the number of cells it is judged together with: the largest family among the readings that show it.

    Each kind of family is counted apart: the paper's primary claims, those on extras, timings. A cell under a switch is
    judged as that of the reading which the switch starts from: so equal measurements have equal verdicts.
    """
    stochastic: tuple[Family, ...] = ("primary", "extra", "timing")
    sizes = {family: family_sizes(paper, cells, outlines, family) for family in stochastic}

    def size(cell: Cell) -> int:
        shown, reading = outlines[cell.form.scenario].shown, cell.start or cell.reading
        return max([1, *(n for seen, n in sizes.get(cell.family, {}).items() if shown(seen) == reading)])

    return size


def claim_verdicts(paper: Paper, rows: Sequence[Row], outlines: Outlines) -> tuple[ClaimVerdict, ...]:
    """The verdict on every claim under every reading of the paper, in the order of the file."""
    readings = dict.fromkeys(reading for name in paper.scenarios for reading in outlines[name].readings)
    deciding: dict[str, list[Row]] = {}
    for row in rows:
        if row.cell.role == "decides":
            deciding.setdefault(row.cell.id, []).append(row)

    def under(reading: str, found: Iterable[Row]) -> Iterator[Row]:
        return (row for row in found if row.cell.reading == outlines[row.cell.form.scenario].shown(reading))

    verdicts = []
    for identity, found in deciding.items():
        shown = {reading: tuple(under(reading, found)) for reading in readings}
        shown = {reading: cells for reading, cells in shown.items() if cells}
        claim = found[0].cell.claim
        verdict = {reading: combine([row.verdict for row in cells], claim.holds) for reading, cells in shown.items()}
        extreme = {reading: _decisive(cells, claim) for reading, cells in shown.items()}
        headline = claim.id in paper.headline
        verdicts.append(ClaimVerdict(identity, claim, headline, verdict, shown, extreme))
    return tuple(verdicts)


def under_switch(cells: Iterable[Cell], paper: Paper, scenario: str, first: str, switch: str) -> list[Cell]:
    """The deciding cells of the headline claims of a scenario, to be measured under a sensitivity switch.

    `first` is the reading that the switches start from; stats of a switch are asked for under its name as a reading.
    Only what is drawn can differ under a switch: exact checks have no reading, and times are measured without switches.
    """
    return [
        replace(cell, reading=switch, start=first)
        for cell in cells
        if (cell.role, cell.form.scenario, cell.reading) == ("decides", scenario, first)
        and cell.claim.id in paper.headline
        and cell.family in ("primary", "extra")
    ]


def _observed(cell: Cell, stats: Stats | None) -> Observation | None:
    """What the results say about a cell; None where they do not hold what it needs."""
    if stats is None or cell.kind in BY_WORD:
        return None
    try:
        if cell.form.check:
            deviation, tolerance = stats.check(cell.form.check)
            return Observation(Measured(deviation, 0.0, 0, "exact", 0, tolerance))
        return observe(cell.form.estimand, stats, cell.reading) if cell.form.estimand else None
    except KeyError:
        return None


def _decisive(rows: tuple[Row, ...], claim: Claim) -> Row:
    return rows[decisive([(row.verdict, row.judgement.flip_percent) for row in rows], claim.holds)]
