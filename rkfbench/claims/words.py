"""Verdicts in words: one sentence a cell, one line a paper."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import inf, isnan, nan
from typing import Any

from rkfbench.claims.ledger import ClaimVerdict, Row, counts
from rkfbench.claims.verdict import Verdict

_OTHERS: tuple[Verdict, ...] = ("not reproduced", "inconclusive", "not testable", "unsupported", "not run")
IN_TEXT = ("text", "literature")  # what the papers say, or cite; the rest is counted apart


def sentence(row: Row) -> str:
    """`hkf - aladkf in err_norm at rate=0.4: 0.2700 +- 0.0060, claimed > 0: reproduced (would flip at 0.25, ...)`."""
    judgement, observed, form = row.judgement, row.observed, row.cell.form
    if observed is None:
        subject = "" if form.text == row.verdict else f"{form.text}: "
        return f"{subject}{row.verdict}" + (f" ({judgement.reason})" if judgement.reason else "")
    measured = observed.measured
    if measured.law == "exact":
        return f"{form.text}: {measured.estimate:.3g}, tolerance {row.region.high:.3g}: {row.verdict}"
    subject = f"win probability of {form.text}" if observed.decided_on == "wins" else form.text
    text = f"{subject}: {measured.estimate:.4g} +- {measured.se:.2g}"
    if form.printed:
        text += f", printed {form.printed.value:g}: {row.verdict}"
    elif row.verdict != "shown":
        text += f", claimed {row.region}: {row.verdict}"
    notes = [*_judgement_notes(row), *_run_notes(row)]
    return text + (f" ({'; '.join(notes)})" if notes else "")


def _judgement_notes(row: Row) -> Iterable[str]:
    judgement = row.judgement
    if judgement.reason:
        yield judgement.reason
    if not isnan(judgement.resolution):
        yield f"resolution {_percent(judgement.resolution)}"
    if not isnan(judgement.flip_at) and abs(judgement.flip_at) < inf:
        scale = row.observed.measured.scale if row.observed else nan
        away = distance(judgement.flip, judgement.flip_percent, scale, row.cell.form.printed is not None)
        yield f"would flip at {judgement.flip_at:.4g}{away}"
    if row.verdict == "inconclusive" and row.observed and row.observed.measured.runs > 1:
        runs = "repeats" if row.cell.family == "timing" else "runs"
        needed = judgement.runs_needed
        yield (
            f"about {_rounded(needed)} {runs} would decide"
            if needed
            else f"no affordable number of {runs} would decide"
        )


def _run_notes(row: Row) -> Iterable[str]:
    observed = row.observed
    if observed and (observed.lost or observed.failed):
        yield f"{observed.lost} runs lost, {observed.failed} of them failed"
        yield f"mean {observed.mean:.4g}, median {observed.median:.4g}"
    if observed and observed.chosen:
        yield f"chosen on tuning runs: {observed.chosen}"


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
    total = counts(verdicts, reading)
    timed = total.pop("timing", Counter())
    said = sum((total[each] for each in IN_TEXT if each in total), Counter[Verdict]())
    apart = sum((number for each, number in total.items() if each not in IN_TEXT), Counter[Verdict]())
    return phrase(said, apart, timed)


def phrase(said: Counter[Any], apart: Counter[Any], timed: Counter[Any]) -> str:
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
        "| claim | the paper says | reading | verdict | decided by |",
        "|---|---|---|---|---|",
    ]
    for each in verdicts:
        says = f"{each.claim.says} ({each.claim.locator})" if each.claim.locator else each.claim.says
        for reading, verdict in each.verdicts.items():
            row = each.decisive.get(reading)
            cells = (each.id, says, reading, verdict, sentence(row) if row else "")
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
            says = ""
    return "\n".join(lines) + "\n"
