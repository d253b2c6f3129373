"""Claims as the page shows them: the stored rows of claims.csv joined with what the paper's file says of each claim."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rkfbench.claims import words
from rkfbench.claims.verdict import Holds, combine
from rkfbench.claims.words import phrase
from rkfbench.report import forest
from rkfbench.report.material import distinct, text
from rkfbench.report.numbers import written
from rkfbench.scenario.claims import Claim
from rkfbench.scenario.paper_schema import Paper

Row = Mapping[str, Any]
ORDER = ("reproduced", "not reproduced", "inconclusive", "not testable", "unsupported", "not run")
SWITCH = "+"


@dataclass(frozen=True)
class ClaimView:
    """A claim with its cells, its verdict under each reading and, for headline claims, under each switch."""

    id: str
    says: str
    locator: str
    evidence: str
    headline: bool
    extra: bool
    timing: bool  # decided by a clock: true of one machine only
    verdicts: dict[str, str]
    switches: dict[str, str]
    cells: dict[str, list[Row]]
    beside: dict[str, list[Row]]
    holds: Holds = "all"

    @property
    def seen(self) -> list[tuple[str, list[Row], list[Row]]]:
        """(readings, deciding cells, cells beside); readings that see the same cells are one: `literal, conjecture`."""
        groups: dict[tuple[int, ...], list[str]] = {}
        for reading, cells in self.cells.items():
            groups.setdefault(tuple(map(id, (*cells, *self.beside[reading]))), []).append(reading)
        return [(", ".join(names), self.cells[names[0]], self.beside[names[0]]) for names in groups.values()]

    @property
    def lines(self) -> list[forest.Line]:
        """The deciding cell under each reading of the paper, placed for the forest plot."""
        return [
            replace(
                forest.line(cells, self.holds),
                reading=readings,
                rests_on=self._rests_on(cells),
            )
            for readings, cells, _ in self.seen
        ]

    @property
    def apart(self) -> str:
        """Why it is not counted with what the paper says."""
        return words.apart(self.evidence, self.timing, self.extra)

    @property
    def where(self) -> str:
        """Its place in the paper, and why it is not counted with what the paper says."""
        return "; ".join(filter(None, (self.locator, self.apart)))

    @property
    def found(self) -> str:
        """What the exact check that decides it says of what it found, which is the same under every reading."""
        cells = next(iter(self.cells.values()), [])
        row = forest.deciding(cells, self.holds) if cells else {}
        return text(row.get("reason")) if row.get("law") == "exact" else ""

    def rests_on(self, reading: str) -> str:
        """What the reader should know of the cells behind the verdict under a reading."""
        return self._rests_on(self.cells.get(reading, []))

    def _rests_on(self, cells: Sequence[Row]) -> str:
        lost = mostly_lost(forest.deciding(cells, self.holds)) if cells else ""
        if lost and len(cells) > 1:
            lost += " in the one that decides"
        return "; ".join(filter(None, (words.among([row["verdict"] for row in cells], self.holds), lost)))


def claim_views(
    rows: Sequence[Row],
    readings: Sequence[str],
    of_scenario: Mapping[str, Sequence[str]],
    paper: Paper | None,
    own: Sequence[Claim],
) -> list[ClaimView]:
    """Every claim that has rows, in their order.

    A scenario that lacks one of the paper's `readings` is seen under its own first one (`of_scenario`).
    """

    def under(reading: str, cells: Sequence[Row]) -> list[Row]:
        offered = {name: reading if reading in names else names[0] for name, names in of_scenario.items()}
        return [row for row in cells if text(row["reading"]) == offered.get(text(row["scenario"]), reading)]

    says = [*(paper.claims if paper else []), *own]
    headline = paper.headline if paper else [claim.id for claim in own if not claim.extra][:6]
    views = []
    for identity in distinct(text(row["claim"]) for row in rows):
        mine = [row for row in rows if text(row["claim"]) == identity]
        claim = claim_of(identity, says)
        deciding = [row for row in mine if row["role"] == "decides"]
        shown = {reading: cells for reading in readings if (cells := under(reading, deciding))}
        switched: dict[str, list[Row]] = {}
        for row in deciding:
            if SWITCH in text(row["reading"]):
                switched.setdefault(text(row["reading"]).partition(SWITCH)[2], []).append(row)
        aside = [row for row in mine if row["role"] != "decides"]
        views.append(
            ClaimView(
                identity,
                claim.says if claim else "",
                claim.locator if claim else "",
                "ours" if paper and claim in own else text(mine[0]["evidence"]),
                claim is not None and claim.id in headline,
                claim is not None and claim.extra,
                any(row["family"] == "timing" for row in deciding),
                {reading: _verdict(cells, claim) for reading, cells in shown.items()},
                {switch: _verdict(cells, claim) for switch, cells in switched.items()},
                shown,
                {reading: under(reading, aside) for reading in readings},
                claim.holds if claim else "all",
            )
        )
    return views


def claim_of(identity: str, claims: Sequence[Claim]) -> Claim | None:
    """The claim of this id; one that is written with {row} or {column} stands for several."""
    return next((each for each in claims if _is(each.id, identity)), None)


def tally(claims: Sequence[ClaimView], reading: str) -> list[tuple[str, int]]:
    """(verdict, number) of the claims that the paper's text makes, under a reading."""
    counted = _counted(claims, reading)["said"]
    return [(verdict, counted[verdict]) for verdict in ORDER if counted[verdict]]


def sentence(claims: Sequence[ClaimView], reading: str) -> str:
    """`22 of 30 claims reproduced, 5 not reproduced, 3 inconclusive; of 4 reconstructed or our own, 3 reproduced.`"""
    said = phrase(**_counted(claims, reading))
    return f"{said[0].upper()}{said[1:]}."


def mark(verdict: str) -> str:
    """The sign of a verdict, which tells it without colour."""
    return forest.MARKS.get(verdict, "–")


def css_class(verdict: str) -> str:
    return {"reproduced": "yes", "not reproduced": "no", "inconclusive": "open"}.get(verdict, "none")


def interval(row: Row) -> str:
    """`[2.47, 2.51]`, with the digits that its width supports."""
    low, high = row.get("lower"), row.get("upper")
    if low is None or high is None or row.get("law") == "exact":
        return ""
    ends = (replace(written(end, (high - low) / 2), error="") for end in (low, high))
    return f"[{', '.join(end.text() for end in ends)}]"


def estimate(row: Row) -> str:
    """`2.490 ± 0.012`; for a printed number or a check what it is compared with stands in another column."""
    if row.get("estimate") is None:
        return "–"
    return written(row["estimate"], None if row.get("law") == "exact" else row.get("se")).text()


def claimed(row: Row) -> str:
    """The claimed region, or the printed number."""
    if row.get("printed_runs"):
        return f"printed {row['printed']:g}"
    return text(row.get("claimed"))


def remarks(row: Row) -> str:
    """What the ledger tells of a cell besides its numbers."""
    return "; ".join(words.remarks(row))


def mostly_lost(row: Row) -> str:
    """`1990 of 2000 runs lost`, where those are more than half: then a verdict rests on runs that say little."""
    lost, runs = row.get("lost") or 0, row.get("all_runs") or 0
    return f"{lost} of {runs} runs lost" if 2 * lost > runs > 0 else ""


def _counted(claims: Sequence[ClaimView], reading: str) -> dict[str, Counter[str]]:
    """The verdicts on what the papers say, on what is reconstructed or ours, and on times; without extras."""
    there = (claim for claim in claims if reading in claim.verdicts and not claim.extra)
    return words.counts((claim.verdicts[reading], claim.evidence, claim.timing) for claim in there)


def _verdict(cells: Sequence[Row], claim: Claim | None) -> str:
    return combine([row["verdict"] for row in cells], claim.holds if claim else "all")


def _is(template: str, identity: str) -> bool:
    """Whether a claim written with {row} or {column} in its id became the claim `identity`."""
    pattern = re.sub(r"\\\{(?:row|column)\\\}", ".+", re.escape(template))
    return re.fullmatch(pattern, identity) is not None
