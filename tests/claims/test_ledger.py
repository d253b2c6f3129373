from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rkfbench.claims import records
from rkfbench.claims.ledger import ClaimVerdict, Row, claim_verdicts, family_of, ledger, under_switch
from rkfbench.claims.plan import Outline, plan
from rkfbench.claims.records import COLUMNS, KEY, record, stored, verify
from rkfbench.claims.verdict import judge
from rkfbench.claims.words import among, markdown, remarks, sentence, summary
from rkfbench.errors import UsageError
from rkfbench.report.verdicts import claim_views
from rkfbench.report.verdicts import remarks as page
from rkfbench.report.verdicts import sentence as said_by_the_report
from rkfbench.scenario.paper_schema import Paper
from tests.claims.fakes import Arrays

M = 100
RNG = np.random.default_rng(3)
COMMON = RNG.normal(size=M)
STATS = Arrays(
    {
        (case, filter, metric): level + 0.02 * k + COMMON + 0.2 * RNG.normal(size=M)
        for k, case in enumerate(("R1", "R2"))
        for filter, level in (("a", 8.0), ("b", 7.0), ("c", 6.98))
        for metric in ("e", "time_ms")
    },
    checks={"p.T1": (1e-12, 1e-9)},
)
OUTLINES = {"s": Outline(("literal", "root"), ("R1", "R2"), ("a", "b", "c", "x"), ("e",), ("p.T1",), paper_runs=25)}
BASE: dict[str, Any] = {"metric": "e", "cases": ["R1", "R2"]}
CLAIMS: list[dict[str, Any]] = [
    {"id": "P-1", "ordering": BASE | {"filters": ["a", "b"]}, "beside": [{"show": BASE | {"filters": "a / b"}}]},
    {"id": "P-2", "ordering": BASE | {"filters": ["b", "a"]}, "evidence": "literature"},
    {"id": "P-3", "ordering": BASE | {"filters": ["b", "c"]}, "evidence": "reconstruction"},
    {"id": "P-4", "exact": {"check": "p.T1"}},
    {"id": "P-5", "unsupported": {"reason": "sec. 4 gives no proof"}},
    {"id": "P-6", "not_testable": {"reason": "no numbers in the figure"}},
    {"id": "P-7", "ordering": BASE | {"filters": ["a", "x"]}, "extra": True},
    {"id": "P-8", "ordering": BASE | {"metric": "time_ms", "filters": ["a", "b"]}},
    {"id": "t-{row}", "value": {"table": "t"}, "evidence": "ours"},
]
TABLE = {
    "title": "T",
    "runs": 25,
    "metric": "e",
    "columns": [{"label": "R1", "case": "R1"}, {"label": "R2", "case": "R2"}],
    "rows": [
        {"label": "A", "filter": "a", "values": [8.0, 8.0]},
        {"label": "B", "filter": "b", "values": [7.0, 12.0]},
    ],
}


def paper(**changes: Any) -> Paper:
    claims = [{"says": "x", **claim} for claim in changes.pop("claims", CLAIMS)]
    base = {"cite": "x", "scenarios": ["s"], "headline": ["P-1"], "tables": {"t": TABLE}, "claims": claims}
    return Paper.model_validate(base | changes)


def rows(of: Paper | None = None) -> tuple[Row, ...]:
    of = of or paper()
    return ledger(of, plan(of, OUTLINES), {"s": STATS}, OUTLINES)


def verdicts() -> dict[str, ClaimVerdict]:
    return {each.id: each for each in claim_verdicts(paper(), rows(), OUTLINES)}


def test_every_claim_has_a_verdict_under_every_reading_in_the_order_of_the_file() -> None:
    found = {name: dict(each.verdicts) for name, each in verdicts().items()}
    assert list(found) == ["P-1", "P-2", "P-3", "P-4", "P-5", "P-6", "P-7", "P-8", "t-a", "t-b"]
    assert found == {
        name: {"literal": verdict, "root": verdict}
        for name, verdict in {
            "P-1": "reproduced",
            "P-2": "not reproduced",
            "P-3": "inconclusive",
            "P-4": "reproduced",
            "P-5": "unsupported",
            "P-6": "not testable",
            "P-7": "not run",
            "P-8": "reproduced",
            "t-a": "reproduced",
            "t-b": "not reproduced",
        }.items()
    }


def test_the_decisive_row_is_the_weakest_of_a_claim_that_holds_and_the_worst_of_one_that_fails() -> None:
    holds, fails = verdicts()["P-1"], verdicts()["t-b"]
    margins = [row.judgement.flip_percent for row in holds.rows["root"]]
    assert holds.decisive["root"].judgement.flip_percent == min(margins)
    assert fails.decisive["root"].cell.form.printed is not None
    assert fails.decisive["root"].cell.form.printed.value == 12.0


def test_a_claim_that_may_hold_anywhere_is_decided_by_its_strongest_cell_in_ledger_and_report() -> None:
    of = paper(claims=[{"id": "P-1", "holds": "any", "ordering": BASE | {"filters": ["a", ["b", "c"]]}}])
    found = ledger(of, plan(of, OUTLINES), {"s": STATS}, OUTLINES)
    (claim,) = claim_verdicts(of, found, OUTLINES)
    margins = [row.judgement.flip_percent for row in claim.rows["root"]]
    assert claim.decisive["root"].judgement.flip_percent == max(margins) > min(margins)
    (view,) = claim_views(list(map(record, found)), ["root"], {"s": ("literal", "root")}, of, [])
    assert view.lines[0].estimand == claim.decisive["root"].cell.form.text


def test_families_are_judged_apart() -> None:
    of = paper()
    cells = plan(of, OUTLINES)
    size = family_of(of, cells, OUTLINES)
    sizes = {cell.id: size(cell) for cell in cells}
    assert sizes["P-1"] == sizes["t-a"] == 10  # three orderings in two cases, and four printed numbers
    assert (sizes["P-7"], sizes["P-8"], sizes["P-4"]) == (2, 2, 1)


def test_a_row_shows_what_the_papers_own_number_of_runs_could_have_seen() -> None:
    row = rows()[0]
    assert row.observed is not None
    there = judge(row.observed.measured.at(25), row.region, row.family_size)
    assert row.paper_runs == 25
    assert row.at_paper_runs == there.verdict


def test_a_summary_keeps_apart_what_the_paper_says_what_is_ours_and_what_a_clock_decides_without_extras() -> None:
    assert summary(verdicts().values(), "root") == (
        "2 of 5 claims reproduced, 1 not reproduced, 1 not testable, 1 unsupported; "
        "of 3 reconstructed or our own, 1 reproduced; of 1 on computing times, 1 reproduced"
    )


def test_the_report_says_the_same_as_the_terminal() -> None:
    lines = list(map(record, rows()))
    readings = OUTLINES["s"].readings
    views = claim_views(lines, readings, {"s": readings}, paper(), [])
    for reading in readings:
        assert said_by_the_report(views, reading) == f"{summary(verdicts().values(), reading)}."
        assert {each.id: each.verdicts[reading] for each in views} == {
            name: each.verdicts[reading] for name, each in verdicts().items()
        }


def test_headline_claims_are_measured_again_under_a_switch() -> None:
    of = paper()
    cells = under_switch(plan(of, OUTLINES), of, "s", "literal", "mixture R")
    assert [cell.key for cell in cells] == [
        ("P-1", "decides", "ordering", f"a - b in e at {case}", "s", "mixture R") for case in ("R1", "R2")
    ]


def test_equal_measurements_have_equal_verdicts_with_and_without_a_switch() -> None:
    of = paper(headline=["P-1", "P-3", "P-7"])
    cells = plan(of, OUTLINES)
    switched = under_switch(cells, of, "s", "literal", "literal+mixture R")
    found = ledger(of, [*cells, *switched], {"s": STATS}, OUTLINES)
    judged = {(row.cell.id, row.cell.reading, row.cell.form.text): (row.family_size, row.judgement) for row in found}
    assert {each.id for each in switched} == {"P-1", "P-3", "P-7"}
    for each in switched:
        assert judged[each.id, each.reading, each.form.text] == judged[each.id, "literal", each.form.text]


def test_exact_checks_and_times_are_no_results_of_a_switch() -> None:
    of = paper(headline=["P-1", "P-4", "P-5", "P-8"])
    assert {cell.id for cell in under_switch(plan(of, OUTLINES), of, "s", "literal", "mixture R")} == {"P-1"}


def test_a_scenario_without_results_is_not_run() -> None:
    of = paper()
    found = {row.verdict for row in ledger(of, plan(of, OUTLINES), {}, OUTLINES)}
    assert found == {"not run", "unsupported", "not testable"}


def test_sentences_say_estimate_claim_verdict_and_margin() -> None:
    said = {row.cell.id: sentence(row) for row in rows() if row.cell.role == "decides"}
    assert said["P-1"].startswith("a - b in e at R2: ")
    assert "claimed > 0: reproduced (would flip at" in said["P-1"]
    assert re.search(r", from the edge by [\d.]+ % of the level [\d.]+\)", said["P-1"])
    assert "runs would decide" in said["P-3"]
    assert said["P-4"] == "deviation of p.T1: 1e-12, tolerance 1e-09: reproduced"
    assert said["P-5"] == "unsupported (sec. 4 gives no proof)"
    assert "printed 12: not reproduced" in said["t-b"]
    assert "from the printed number by" in said["t-b"]
    assert "resolution" in said["t-a"]


def test_the_sentence_on_a_check_has_its_own_words_and_no_negative_zero() -> None:
    (row,) = (row for row in rows() if row.cell.id == "P-4" and row.cell.reading == "literal")
    assert row.observed is not None
    at_zero = replace(row.observed, measured=replace(row.observed.measured, estimate=-0.0))
    noted = replace(row, observed=at_zero, judgement=replace(row.judgement, reason="rank 3 of 4"))
    assert sentence(noted) == "deviation of p.T1: 0, tolerance 1e-09: reproduced (rank 3 of 4)"


def test_a_row_that_is_written_and_read_is_judged_the_same_to_the_last_bit() -> None:
    of, first = paper(), rows()
    cells = plan(of, OUTLINES)
    lines = [record(row) for row in first]
    again, changes = verify(of, cells, map(stored, lines), OUTLINES)
    assert changes == ()
    assert [record(row) for row in again] == lines
    assert all(tuple(line) == COLUMNS for line in lines)
    assert len({tuple(line[name] for name in KEY) for line in lines}) == len(lines)


def test_text_read_from_a_file_gives_the_same_rows() -> None:
    of, first = paper(), rows()

    def through_text(value: object) -> object:  # what a CSV file does to a value
        text = "" if value is None else repr(value) if isinstance(value, float) else str(value)
        if text == "":
            return None
        for kind in (int, float):
            try:
                return kind(text)
            except ValueError:
                pass
        return text

    lines = [{name: through_text(value) for name, value in record(row).items()} for row in first]
    again, changes = verify(of, plan(of, OUTLINES), map(stored, lines), OUTLINES)
    assert changes == ()
    assert [record(row) for row in again] == [record(row) for row in first]


def test_a_region_moved_past_the_estimate_flips_the_verdict_from_stored_lines_alone() -> None:
    lines = [stored(record(row)) for row in rows()]
    moved = [dict(claim) for claim in CLAIMS]
    moved[0]["ordering"] = moved[0]["ordering"] | {"margin": 3.0}
    changed = paper(claims=moved)
    _, changes = verify(changed, plan(changed, OUTLINES), lines, OUTLINES)
    assert {(each.key[0], each.before, each.now, each.matters) for each in changes} == {
        ("P-1", "reproduced", "not reproduced", True)
    }


def test_new_and_vanished_claims_are_changes_and_times_never_matter() -> None:
    lines = [stored(record(row)) for row in rows()]
    renamed = paper(claims=[*CLAIMS[:-1], {"id": "P-9", "bound": BASE | {"filters": "a", "above": 1}}])
    _, changes = verify(renamed, plan(renamed, OUTLINES), lines, OUTLINES)
    assert {(each.key[0], each.before == "", each.now) for each in changes} == {
        ("P-9", True, "not run"),
        ("t-a", False, ""),
        ("t-b", False, ""),
    }
    slower = paper(claims=[*CLAIMS[:7], {"id": "P-8", "ordering": CLAIMS[7]["ordering"] | {"margin": 9.0}}, CLAIMS[8]])
    _, changes = verify(slower, plan(slower, OUTLINES), lines, OUTLINES)
    assert {(each.key[0], each.matters) for each in changes} == {("P-8", False)}


def test_a_line_of_another_version_is_refused() -> None:
    line = record(rows()[0])
    with pytest.raises(UsageError, match="no lower"):
        stored({name: value for name, value in line.items() if name != "lower"})
    with pytest.raises(UsageError, match="claim P-1"):
        stored(line | {"estimate": "many"})


def test_a_stored_win_probability_is_judged_as_one() -> None:
    gone = Arrays(STATS.arrays, {("R1", "b"): np.arange(M) < 2}, STATS.checks)
    of = paper()
    cells = plan(of, OUTLINES)
    first = ledger(of, cells, {"s": gone}, OUTLINES)
    assert first[0].observed is not None
    assert first[0].observed.decided_on == "wins"
    again, changes = verify(of, cells, [stored(record(row)) for row in first], OUTLINES)
    assert changes == ()
    assert again[0].region == first[0].region == replace(first[0].region, low=0.5)
    assert records.record(again[0]) == record(first[0])


def test_the_deciding_cells_of_a_claim_are_counted_by_their_verdicts() -> None:
    assert among(["reproduced"]) == ""
    assert among(["inconclusive"] * 2) == "both cells"
    assert among(["reproduced"] * 96) == "all 96 cells"
    mixed = [*["reproduced"] * 46, *["not reproduced"] * 42, *["inconclusive"] * 8]
    assert among(mixed) == "46 of 96 cells reproduced, 42 not, 8 inconclusive"
    assert among(["not reproduced", "not run"]) == "0 of 2 cells reproduced, 1 not, 1 not run"
    assert among(["reproduced", "inconclusive"], "any") == "1 of 2 cells reproduced, 1 inconclusive, one is enough"


def test_the_page_tells_of_a_cell_what_the_ledger_tells() -> None:
    for row in rows():
        assert row.cell.kind == "exact" or sentence(row).endswith(f"({said})" if (said := page(record(row))) else "")
    timed = {"verdict": "inconclusive", "family": "timing", "runs": 20}
    assert list(remarks(timed | {"runs_needed": 2859})) == ["about 2900 repeats would decide"]
    assert list(remarks(timed | {"family": "primary"})) == ["no affordable number of runs would decide"]
    lost = {"verdict": "reproduced", "lost": 3, "failed": 1, "mean": None, "median": 2.5, "chosen": "a"}
    assert list(remarks(lost)) == ["3 runs lost, 1 of them failed", "median 2.5", "chosen on tuning runs: a"]


def test_the_markdown_ledger_marks_what_is_not_counted_with_what_the_papers_say() -> None:
    lines = {
        line.split(" | ")[0].strip("| "): line for line in reversed(markdown("", verdicts().values()).splitlines())
    }
    marks = {"P-1": "x |", "P-2": "x |", "P-3": "x (evidence: reconstruction) |", "t-a": "x (evidence: ours) |"}
    marks |= {"P-7": "x (extra) |", "P-8": "x (computing time) |"}
    assert {name: lines[name].split(" | ")[1] + " |" for name in marks} == marks
    assert "the paper says" not in "".join(lines)
    assert "| reproduced (both cells) |" in lines["P-1"]
    assert "| not reproduced (1 of 2 cells reproduced, 1 not) |" in lines["t-b"]


def test_what_must_be_said_stands_below_the_title_of_the_ledger() -> None:
    lines = markdown("Ledger", [], ("What it is.", "", "A guess.")).splitlines()
    assert lines[:5] == ["# Ledger", "", "What it is.", "", "A guess."]


def test_the_markdown_ledger_has_a_row_for_each_claim_and_reading_and_no_broken_cell() -> None:
    found = verdicts().values()
    lines = markdown("Ledger", found).splitlines()
    assert len(lines) == 4 + sum(len(each.verdicts) for each in found)
    assert {line.replace("\\|", "").count("|") for line in lines[2:]} == {6}
    assert all(each.id in "\n".join(lines) for each in found)
