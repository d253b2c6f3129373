from __future__ import annotations

import base64
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from rkfbench.errors import UsageError
from rkfbench.report import verdicts
from rkfbench.report.page import write_report
from rkfbench.report.render import render
from rkfbench.store import Results, files, manifest
from tests.report import fakes
from tests.report.fakes import RUNS

VOID = {"meta", "link", "img", "br", "hr", "input"}


class Page(HTMLParser):
    """Collects tags and complains about what is not nested."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(dict(attrs)) == len(attrs), f"an attribute stands twice in {tag}"
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += f" {data}"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("page")
    fakes.write_results(place / "fake")
    render(place / "fake")
    write_report([place / "fake"], place)
    return place


@pytest.fixture(scope="module")
def page(written: Path) -> Page:
    return Page((written / "report.html").read_text(encoding="utf-8"))


def test_the_page_is_well_formed(page: Page) -> None:
    ids = [attrs["id"] for _, attrs in page.tags if "id" in attrs]
    assert page.open == []
    assert len(set(ids)) == len(ids)
    assert sum(tag == "h1" for tag, _ in page.tags) == 1


def test_the_page_needs_no_network_and_no_script(page: Page) -> None:
    sources = [attrs.get("src") or "" for tag, attrs in page.tags if tag in ("img", "iframe", "video")]
    links = [attrs.get("href") or "" for tag, attrs in page.tags if tag == "link"]
    assert "script" not in {tag for tag, _ in page.tags}
    assert all(source.startswith("data:") for source in (*sources, *links))
    assert not any(name.startswith("on") for _, attrs in page.tags for name in attrs)


def test_a_picture_is_shown_without_the_caption_at_its_foot_which_stands_beside_it(page: Page, written: Path) -> None:
    shown = next(attrs for tag, attrs in page.tags if tag == "img" and (attrs["alt"] or "").startswith("fig1"))
    file = (written / "fake" / "figures" / "fig1.literal.png").read_bytes()
    whole = [int.from_bytes(file[place : place + 4], "big") for place in (16, 20)]  # of the PNG header
    width, height = map(int, re.findall(r"\d+", shown["style"] or ""))
    assert base64.b64decode((shown["src"] or "").partition(",")[2]) == file
    assert shown["width"] == str(width)
    assert 0.75 < (height / width) / (whole[1] / whole[0]) < 0.95


def test_a_missing_picture_is_named(folder: Path) -> None:
    render(folder)
    (folder / "figures" / "fig1.root.png").unlink()
    with pytest.raises(UsageError, match=r"fig1\.root\.png is missing: make it again with rkfbench report"):
        write_report([folder], folder)


def test_links_inside_the_page_lead_somewhere(page: Page) -> None:
    ids = {attrs["id"] for _, attrs in page.tags if "id" in attrs}
    inside = [attrs["href"] or "" for tag, attrs in page.tags if tag == "a" and (attrs["href"] or "").startswith("#")]
    assert inside
    assert {link[1:] for link in inside} <= ids


def test_every_picture_says_what_it_shows(page: Page) -> None:
    pictures = [attrs for tag, attrs in page.tags if tag == "img"]
    plots = [attrs for tag, attrs in page.tags if tag == "svg" and attrs.get("role") == "img"]
    assert len(pictures) == 4
    assert all("60 runs" in (each["alt"] or "") or "interval" in (each["alt"] or "") for each in pictures)
    assert len(plots) == 4
    assert all("estimate" in (each["aria-label"] or "") for each in plots)


def test_the_first_screen_counts_the_verdicts_of_each_reading(page: Page) -> None:
    text = " ".join(page.text.split())
    assert "literal: Of 2 reconstructed or our own, 1 reproduced. root: Of 2" in text


def test_a_caveat_stands_wherever_its_reading_is_shown(written: Path, page: Page) -> None:
    sheets = (written / "report.md").read_text(encoding="utf-8")
    table = next(line for line in sheets.splitlines() if line.startswith("| A study"))
    assert table.count("A guess of ours.") == 1
    assert table.index("*root*") < table.index("A guess of ours.")
    for heading in ("### Headline claims", "### Full ledger"):
        assert f"{heading}\n\n*root*: A guess of ours.\n\n|" in sheets
    shown = [line for line in sheets.splitlines() if "Reading root." in line]
    assert len(shown) == 3  # a table, and a figure's image and caption
    assert all("Reading root. A guess of ours." in line for line in shown)
    assert "A guess of ours." in (written / "fake" / "tables" / "table1.tex").read_text(encoding="utf-8")
    assert page.text.count("A guess of ours.") >= 5


def test_notes_stand_below_the_name_of_the_scenario(written: Path) -> None:
    assert "### fake\n\nWhat <one> must know of it.\n" in (written / "report.md").read_text(encoding="utf-8")
    assert "What &lt;one&gt; must know of it." in (written / "report.html").read_text(encoding="utf-8")


def test_readings_that_see_the_same_cells_share_a_line() -> None:
    row, other = fakes.claim_row(), fakes.claim_row(reading="root")
    view = verdicts.claim_views([row], ["literal", "root"], {"fake": ["literal"]}, None, [])[0]
    assert [line.reading for line in view.lines] == ["literal, root"]
    view = verdicts.claim_views([row, other], ["literal", "root"], {"fake": ["literal", "root"]}, None, [])[0]
    assert [line.reading for line in view.lines] == ["literal", "root"]


def test_the_ledger_holds_every_cell_with_its_flip_margin_and_what_stands_beside(page: Page) -> None:
    text = " ".join(page.text.split())
    assert "would flip at 2.45, from the edge by 98 % of the level 2.5" in text
    assert "about 700 runs would decide; 3 runs lost, 0 of them failed; mean 2.49, median 2.5" in text
    assert "shown beside" in text


def test_both_pages_tell_whose_a_claim_is_and_what_its_cells_say_in_headline_and_ledger(
    written: Path, page: Page
) -> None:
    text, html = (written / "report.md").read_text(encoding="utf-8"), " ".join(page.text.split())
    assert text.count("the HKF beats the KF <always> (evidence: ours) |") == 2  # under two readings
    assert "the HKF beats the KF <always> | evidence: ours | ● reproduced (both cells) | ◇ inconclusive |" in text
    assert text.count("● reproduced (both cells) |") == 2
    assert html.count("mine-1 the HKF beats the KF <always> evidence: ours") == 1
    assert html.count("mine-1: the HKF beats the KF <always> evidence: ours") == 1
    assert html.count("both cells") == 2


def test_a_verdict_that_rests_on_lost_runs_says_so() -> None:
    def rests_on(*lost: int, verdict: str = "reproduced") -> str:
        rows = [fakes.claim_row(lost=each, all_runs=60, flip_percent=each) for each in lost]
        rows[0] |= {"verdict": verdict}
        (view,) = verdicts.claim_views(rows, ["literal"], {"fake": ["literal"]}, None, [])
        assert view.lines[0].rests_on == view.rests_on("literal")
        return view.rests_on("literal")

    assert rests_on(30) == ""
    assert rests_on(31) == "31 of 60 runs lost"
    assert rests_on(40, 50) == "both cells; 40 of 60 runs lost in the one that decides"
    assert rests_on(40, 50, verdict="not reproduced") == (
        "1 of 2 cells reproduced, 1 not; 40 of 60 runs lost in the one that decides"
    )


def test_lost_runs_are_told_on_both_pages(folder: Path) -> None:
    claims = (folder / "claims.csv").read_text()
    lines = [fakes.claim_row(lost=RUNS - 1, flip_percent=1.0)]
    files.write_records(folder / "claims.csv", claims.splitlines()[0].split(","), lines)
    manifest.seal(folder)
    render(folder)
    for path in write_report([folder], folder):
        assert path.read_text(encoding="utf-8").count(f"{RUNS - 1} of {RUNS} runs lost") == 2  # headline and ledger


def test_the_sensitivity_matrix_has_a_row_a_switch(page: Page) -> None:
    text = " ".join(page.text.split())
    assert re.search(r"switch mine-1 none ● reproduced mixture R ✕ not reproduced", text)


def test_what_is_needed_to_repeat_is_there(page: Page) -> None:
    for words in ("rkfbench run fake", "commit", "process_noise.cov: 4", "threshold = 1.345", "measurement_noise:"):
        assert words in page.text


def test_texts_of_others_are_escaped(written: Path) -> None:
    html = (written / "report.html").read_text(encoding="utf-8")
    assert "Journal of &lt;Examples&gt;" in html
    assert "the HKF beats the KF &lt;always&gt;" in html


def test_the_markdown_says_the_same_and_links_the_pictures(written: Path) -> None:
    text = (written / "report.md").read_text(encoding="utf-8")
    tables = [block for block in re.split(r"\n\s*\n", text) if block.startswith("|")]
    assert "](fake/figures/fig1.root.png)" in text
    assert "| ● reproduced |" in text or "● reproduced |" in text
    for block in tables:
        widths = {len(re.findall(r"(?<!\\)\|", line.strip())) for line in block.splitlines()}
        assert len(widths) == 1, block


def test_the_page_of_a_results_folder_is_sealed_with_it(folder: Path) -> None:
    render(folder)
    write_report([folder], folder)
    assert {"report.html", "report.md"} <= set(Results.open(folder).manifest["files"])


def test_two_scenarios_without_a_paper_stand_side_by_side(written: Path, folder: Path) -> None:
    renamed = (folder / "scenario.yaml").read_text().replace("name: fake", "name: other")
    (folder / "scenario.yaml").write_text(renamed)
    (folder / "claims.csv").unlink()
    manifest.seal(folder)
    render(folder)
    write_report([written / "fake", folder], folder)
    both = Page((folder / "report.html").read_text(encoding="utf-8"))
    assert "No claim was decided." in both.text
    assert {"fake", "other"} <= {attrs.get("id") for _, attrs in both.tags}


def test_a_page_that_is_not_to_go_elsewhere_refers_to_the_files_of_its_figures(folder: Path) -> None:
    render(folder)
    html, _ = write_report([folder], folder, embedded=False)
    sources = re.findall(r'<img src="([^"]+)"', html.read_text(encoding="utf-8"))
    assert sources
    assert all((folder / source).is_file() for source in sources)


def test_the_words_of_an_exact_check_stand_beside_its_claim(folder: Path) -> None:
    rows = [fakes.claim_row(law="exact", reading=each, reason="rank 3 of <4>") for each in fakes.READINGS]
    files.write_records(folder / "claims.csv", list(rows[0]), rows)
    manifest.seal(folder, "claims.csv")
    render(folder)
    html, md = (path.read_text(encoding="utf-8") for path in write_report([folder], folder))
    assert "the check: rank 3 of &lt;4&gt;</small>" in html
    lines = [line for line in md.splitlines() if line.startswith("| **mine-1**")]
    assert [line.count("*(the check: rank 3 of <4>)*") for line in lines] == [1, 1, 1]  # two readings, and the ledger
