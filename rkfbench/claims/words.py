"""Verdicts in words: one sentence a cell, one line a paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import isfinite, isnan, nan
from typing import Any

from rkfbench.claims.ledger import ClaimVerdict, Row
from rkfbench.claims.records import record
from rkfbench.claims.verdict import Holds, Verdict

_OTHERS: tuple[Verdict, ...] = ("not reproduced", "inconclusive", "not testable", "unsupported", "not run")
_SHORT = {"not reproduced": "not"}  # beside how many are reproduced
_MARGIN = ("flip", "flip_percent", "scale")
IN_TEXT = ("text", "literature")  # what the papers say, or cite; the rest is counted apart


def sentence(row: Row) -> str:
    """`hkf - aladkf in err_norm at rate=0.4: 0.2700 +- 0.0060, claimed > 0: reproduced (would flip at 0.25, ...)`."""
    judgement, observed, form = row.judgement, row.observed, row.cell.form
    if observed is None:
        subject = "" if form.text == row.verdict else f"{form.text}: "
        return f"{subject}{row.verdict}" + (f" ({judgement.reason})" if judgement.reason else "")
    measured = observed.measured
    if measured.law == "exact":
        text = f"{form.text}: {measured.estimate + 0.0:.3g}, tolerance {row.region.high:.3g}: {row.verdict}"  # no -0
        return text + (f" ({judgement.reason})" if judgement.reason else "")
    subject = f"win probability of {form.text}" if observed.decided_on == "wins" else form.text
    text = f"{subject}: {measured.estimate:.4g} +- {measured.se:.2g}"
    if form.printed:
        text += f", printed {form.printed.value:g}: {row.verdict}"
    elif row.verdict != "shown":
        text += f", claimed {row.region}: {row.verdict}"
    notes = "; ".join(remarks(record(row)))
    return text + (f" ({notes})" if notes else "")


def remarks(line: Mapping[str, Any]) -> Iterator[str]:
    """What the reader is told of a line of claims.csv besides its numbers: why, how finely, where the verdict would
    flip, what would decide, whose runs were lost, and which filter was chosen.
    """
    if line.get("reason"):
        yield line["reason"]
    if line.get("resolution") is not None:
        yield f"resolution {_percent(line['resolution'])}"
    if line.get("flip_at") is not None and isfinite(line["flip_at"]):
        flip, percent, scale = (nan if line.get(name) is None else line[name] for name in _MARGIN)
        margin = distance(flip, percent, scale, bool(line.get("printed_runs")))
        yield f"would flip at {line['flip_at'] + 0.0:.4g}{margin}"
    if line["verdict"] == "inconclusive" and (line.get("runs") or 0) > 1:
        runs = "repeats" if line["family"] == "timing" else "runs"
        needed = line.get("runs_needed")
        affordable = f"about {_rounded(needed)}" if needed else "no affordable number of"
        yield f"{affordable} {runs} would decide"
    if line.get("lost") or line.get("failed"):
        yield f"{line.get('lost') or 0} runs lost, {line.get('failed') or 0} of them failed"
        beside = [f"{name} {line[name]:.4g}" for name in ("mean", "median") if line.get(name) is not None]
        if beside:
            yield ", ".join(beside)
    if line.get("chosen"):
        yield f"chosen on tuning runs: {line['chosen']}"


def among(verdicts: Sequence[str], holds: Holds = "all") -> str:
    """What the deciding cells of a claim say: `46 of 96 cells reproduced, 42 not, 8 inconclusive`, or `all 96 cells`.

    "" where there is one cell only. holds: whether the claim holds if all of its cells do, or any.
    """
    if len(verdicts) < 2:
        return ""
    number = Counter(verdicts)
    if len(number) == 1:
        return "both cells" if len(verdicts) == 2 else f"all {len(verdicts)} cells"
    others = [f"{number[each]} {_SHORT.get(each, each)}" for each in _OTHERS if number[each]]
    enough = ["one is enough"] if holds == "any" else []
    return ", ".join([f"{number['reproduced']} of {len(verdicts)} cells reproduced", *others, *enough])


def apart(evidence: str, timing: bool, extra: bool) -> str:
    """Why a claim is not counted with what the papers say: `evidence: ours; extra`; "" where it is counted so."""
    whose = "" if evidence in IN_TEXT else f"evidence: {evidence}"
    return "; ".join(filter(None, (whose, "computing time" if timing else "", "extra" if extra else "")))


def distance(flip: float, percent: float, scale: float, printed: bool) -> str:
    """How far the edge of the claimed region, or a printed number, stands from where the verdict would flip, and what
    that is a share of: `scale`, the level of what is compared. Ratios and shares have the level 1; "" where there is
    none.
    """
    if isnan(percent):
        return ""
    if printed:
        return f", from the printed number by {_percent(percent)} of it"
    return f", from the edge by {f'{flip:.2g}' if scale == 1 else f'{_percent(percent)} of the level {scale:.3g}'}"


def _percent(value: float) -> str:
    return f"{value:.2g} %" if value < 100 else f"{value:.0f} %"


def _rounded(number: int) -> int:
    """Up to two digits: 6092 is 6100."""
    unit = 10 ** max(len(str(number)) - 2, 0)
    return -(-number // unit) * unit


def summary(verdicts: Iterable[ClaimVerdict], reading: str) -> str:
    """The verdicts of a paper under a reading as one `phrase`."""
    there = (each for each in verdicts if reading in each.verdicts and not each.claim.extra)
    return phrase(**counts((each.verdicts[reading], each.claim.evidence, each.timing) for each in there))


def counts(claims: Iterable[tuple[str, str, bool]]) -> dict[str, Counter[str]]:
    """Claims by verdict, apart as in `phrase`; of each claim the verdict, the evidence, whether a clock decides."""
    found: dict[str, Counter[str]] = {"said": Counter(), "apart": Counter(), "timed": Counter()}
    for verdict, evidence, timing in claims:
        found["timed" if timing else "said" if evidence in IN_TEXT else "apart"][verdict] += 1
    return found


def phrase(said: Counter[str], apart: Counter[str], timed: Counter[str]) -> str:
    """`22 of 30 claims reproduced, 5 not reproduced, 3 inconclusive; of 4 reconstructed or our own, 3 reproduced`.

    said: what the papers say. apart: what is reconstructed or ours. timed: what a clock decides.
    """
    parts = []
    if said:
        others = [f"{said[verdict]} {verdict}" for verdict in _OTHERS if said[verdict]]
        parts.append(", ".join([f"{said['reproduced']} of {said.total()} claims reproduced", *others]))
    for counted, what in ((apart, "reconstructed or our own"), (timed, "on computing times")):
        if counted:
            parts.append(f"of {counted.total()} {what}, {counted['reproduced']} reproduced")
    return "; ".join(parts) or "no claim was decided"


def markdown(title: str, verdicts: Iterable[ClaimVerdict], about: Iterable[str] = ()) -> str:
    """The ledger as a Markdown table: each claim, its verdict under every reading, and the cell that decides.

    about: paragraphs beneath the title.
    """
    lines = [
        f"# {title}",
        "",
        *(line for each in about if each for line in (each, "")),
        "| id | claim | reading | verdict | decided by |",
        "|---|---|---|---|---|",
    ]
    for each in verdicts:
        aside = "; ".join(filter(None, (each.claim.locator, apart(each.claim.evidence, each.timing, each.claim.extra))))
        says = f"{each.claim.says} ({aside})" if aside else each.claim.says
        for reading, verdict in each.verdicts.items():
            row = each.decisive.get(reading)
            cells_say = among([row.verdict for row in each.rows[reading]], each.claim.holds)
            judged = f"{verdict} ({cells_say})" if cells_say else verdict
            cells = (each.id, says, reading, judged, sentence(row) if row else "")
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
            says = ""
    return "\n".join(lines) + "\n"
