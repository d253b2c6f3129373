"""The report: report.md and one self-contained report.html, for one results folder or for all of a reproduction.

What a reader sees first is one row a paper, with a computed sentence, and its headline claims as intervals against
their claimed regions. The full ledger, tables, figures, sensitivity and provenance are folded behind. The page needs
no network and no script; everything on it is read from the results folders and the papers' files.
"""

from __future__ import annotations

import base64
import hashlib
import json
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rkfbench.errors import UsageError
from rkfbench.report import tables, verdicts
from rkfbench.report.material import distinct, text
from rkfbench.report.render import Outcome, Picture
from rkfbench.report.verdicts import ClaimView
from rkfbench.scenario.display import Table
from rkfbench.store import files, manifest

if TYPE_CHECKING:
    from jinja2 import Environment

NONE: Mapping[Any, Any] = MappingProxyType({})
NAMES = ("report.html", "report.md")
PIXELS = 96  # of the page to an inch of a figure


@dataclass(frozen=True)
class Shown:
    """A figure as the page shows it: its file but for the caption at the foot, which stands beside it as text."""

    picture: Picture
    path: Path  # the PNG of the results folder
    width: int  # of what is shown
    height: int
    file: str  # the PNG relative to the page

    @property
    def data(self) -> str:
        """The PNG as an address that holds it."""
        return f"data:image/png;base64,{base64.b64encode(self.path.read_bytes()).decode()}"


@dataclass(frozen=True)
class ScenarioView:
    """One results folder on the page."""

    outcome: Outcome
    place: Path  # of the page

    @property
    def name(self) -> str:
        return self.outcome.scenario.name

    @classmethod
    def of(cls, folder: str | Path, place: Path) -> ScenarioView:
        """The results folder on a page in the folder `place`."""
        return cls(Outcome.open(folder, rendered=True), place)

    def ahead(self) -> ScenarioView:
        """The view with everything read that takes time, and the templates compiled."""
        _ = self.tables, self.figures, self.outcome.material.own_readings
        for name in NAMES:
            environment().get_template(f"{name}.j2")
        return self

    @cached_property
    def tables(self) -> list[tuple[Table, list[tables.Sheet]]]:
        return [(table, sheets) for table, _, sheets in self.outcome.tables()]

    @cached_property
    def figures(self) -> list[Shown]:
        """The declared figures, as `render` has drawn them."""
        shown = []
        for picture in self.outcome.pictures():
            file = self.outcome.results.folder / "figures" / f"{picture.stem}.png"
            if not file.exists():
                raise UsageError(f"{file} is missing: make it again with rkfbench report {self.outcome.results.folder}")
            width, height = (round(inches * PIXELS) for inches in picture.size)
            shown.append(Shown(picture, file, width, height, relative(file, self.place)))
        return shown

    @property
    def title(self) -> str:
        return self.outcome.scenario.title

    @property
    def notes(self) -> str:
        return self.outcome.scenario.notes

    @property
    def facts(self) -> list[tuple[str, str]]:
        """The manifest without its hashes, as plain words."""
        skipped = ("files", "hashes", "title", "argv", "schema")
        facts = self.outcome.results.manifest.items()
        return [(key, plain(value)) for key, value in facts if key not in skipped and value not in ("", None, [])]

    @property
    def stopped(self) -> str:
        """Where and why the runs ended, if the numbers themselves decided that."""
        return self.outcome.results.stopped

    @property
    def command(self) -> str:
        """What was typed to make these results."""
        argv = self.outcome.results.manifest.get("argv") or ["rkfbench", "run", self.name]
        return shlex.join(argv)

    @property
    def readings(self) -> list[tuple[str, list[tuple[str, str]]]]:
        """Each reading with what it sets."""
        return _overrides(self.outcome.scenario.resolved.get("readings"))

    @property
    def switches(self) -> list[tuple[str, list[tuple[str, str]]]]:
        """Each switch of the sensitivity study with what it sets."""
        return _overrides(self.outcome.scenario.resolved.get("sensitivity"))

    @property
    def filters(self) -> list[tuple[str, str]]:
        """Each filter with every parameter."""
        rows = self.outcome.results.filters
        return [(text(row["label"]), ", ".join(_parameters(row))) for row in rows]

    @property
    def resolved(self) -> str:
        """The scenario as it was run, every default written out."""
        return (self.outcome.results.folder / "scenario.yaml").read_text(encoding="utf-8")


@dataclass(frozen=True)
class PaperView:
    """A paper, or a user's scenario without one, on the page."""

    key: str
    title: str
    cite: str
    doi: str
    claims: list[ClaimView]
    scenarios: list[ScenarioView]
    readings: list[str]
    caveats: dict[str, str]  # reading: what must be said wherever it is shown

    @property
    def headline(self) -> list[ClaimView]:
        return [claim for claim in self.claims if claim.headline]

    @property
    def sentences(self) -> list[tuple[str, str]]:
        """For each reading one computed sentence, and its caveat."""
        told = {reading: verdicts.sentence(self.claims, reading) for reading in self.readings}
        return [(reading, f"{told[reading]} {self.caveats[reading]}".strip()) for reading in self.readings]

    @property
    def warnings(self) -> list[tuple[str, str]]:
        """(readings, caveat) for the headings of the ledger: `reset, keep`; no name where it is about all readings."""
        said = {text: [each for each in self.readings if self.caveats[each] == text] for text in self.caveats.values()}
        return [("" if names == self.readings else ", ".join(names), text) for text, names in said.items() if text]

    @property
    def counts(self) -> list[tuple[str, int]]:
        """Verdicts under the first reading with their numbers, for the bar of the first screen."""
        return verdicts.tally(self.claims, self.readings[0]) if self.readings else []

    @property
    def sensitivity(self) -> tuple[list[ClaimView], list[tuple[str, list[str]]]]:
        """Headline claims, and for each switch their verdicts."""
        claims = [claim for claim in self.headline if claim.switches]
        switches = distinct(switch for claim in claims for switch in claim.switches)
        first = [("none", [claim.verdicts.get(self.readings[0], "") for claim in claims])] if claims else []
        return claims, first + [(switch, [each.switches.get(switch, "") for each in claims]) for switch in switches]


def write_report(
    folders: Sequence[str | Path],
    out: str | Path,
    made_from: str = "",
    embedded: bool = True,
    ready: Mapping[str | Path, ScenarioView] = NONE,
) -> list[Path]:
    """Write report.html and report.md into `out` for these results folders; a results folder is sealed again.

    made_from: a digest of all that goes into them; what bears its stamp is left as it is. embedded: the figures stand
    in the page, which can go anywhere by itself; else it refers to their files. ready: views that are there already.
    """
    place = Path(out)
    paths = [place / name for name in NAMES]
    if made_from and all(_bears(path, made_from) for path in paths):
        return paths
    papers = views(folders, place, ready)
    page = environment()
    for path in paths:
        text = page.get_template(f"{path.name}.j2").render(papers=papers, embedded=embedded).strip() + "\n"
        files.write(path, text + (_stamp(text, made_from) if made_from else ""))
    if manifest.is_sealed(place):
        manifest.seal(place, *NAMES)
    return paths


def _stamp(text: str, made_from: str) -> str:
    """The last line of a page: a hash of the page and of what it was made from, which no edit of either survives."""
    return f"<!-- stamp {hashlib.sha256(f'{made_from} {text}'.encode()).hexdigest()[:16]} -->\n"


def is_stamped(path: Path) -> bool:
    """Whether a page is one that `rkfbench reproduce` wrote into the folder of all results."""
    return path.is_file() and b"\n<!-- stamp " in path.read_bytes()[-60:]


def _bears(path: Path, made_from: str) -> bool:
    try:
        text, mark, rest = path.read_text(encoding="utf-8").rpartition("<!-- stamp ")
    except (OSError, UnicodeError):
        return False
    return mark + rest == _stamp(text, made_from)


def views(
    folders: Sequence[str | Path], place: Path, ready: Mapping[str | Path, ScenarioView] = NONE
) -> list[PaperView]:
    """The results folders, grouped by paper, in the order given; those that decide no claim of it stand last."""
    groups: dict[str, list[ScenarioView]] = {}
    for folder in folders:
        view = ready.get(folder) or ScenarioView.of(folder, place)
        groups.setdefault(view.outcome.scenario.paper or view.name, []).append(view)
    return [_paper_view(key, group) for key, group in groups.items()]


@cache
def environment() -> Environment:
    """The templates beside this file; HTML is escaped, Markdown is not."""
    import jinja2

    page = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=lambda name: bool(name) and ".html" in str(name),
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    page.filters["percent"] = lambda share: f"{100 * share:.2f}%"
    page.filters["bar"] = lambda cell: str(cell).replace("|", r"\|").replace("\n", " ")
    page.globals.update(verdicts=verdicts, markdown_table=tables.markdown, table_title=tables.title)
    return page


def relative(path: Path, place: Path) -> str:
    """`path` as a link from a page in the folder `place`."""
    import os

    return Path(os.path.relpath(path, place)).as_posix()


def plain(value: Any) -> str:
    """A value of the manifest or the scenario in words."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {plain(each)}" for key, each in value.items())
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _paper_view(key: str, scenarios: list[ScenarioView]) -> PaperView:
    paper = scenarios[0].outcome.paper
    scenarios = sorted(scenarios, key=lambda each: bool(paper and each.name not in paper.scenarios))
    outcomes = [each.outcome for each in scenarios]
    first = outcomes[0].scenario
    rows = [row | {"all_runs": each.results.runs} for each in outcomes for row in each.results.claims]
    of_scenario = {outcome.scenario.name: outcome.material.own_readings for outcome in outcomes}
    named = distinct(reading for readings in of_scenario.values() for reading in readings)
    readings = [reading for reading in named if reading != "default"] or named
    own = [claim for outcome in outcomes for claim in outcome.scenario.claims]
    claims = verdicts.claim_views(rows, readings, of_scenario, paper, own)
    cite = paper.cite if paper else first.citation.cite if first.citation else ""
    doi = (paper.doi if paper else first.citation.doi if first.citation else None) or ""
    title = (paper.title if paper else first.title) or key
    caveats = {reading: " ".join(_caveats(outcomes, reading)) for reading in readings}
    return PaperView(key, title, cite, doi, claims, scenarios, readings, caveats)


def _caveats(outcomes: Sequence[Outcome], reading: str) -> list[str]:
    """What must be said of the scenarios whose results one sees under a reading: their own, or their first one."""
    shown = [(each.scenario, each.material.own_readings) for each in outcomes]
    said = [scenario.caveat(reading if reading in own else own[0]) for scenario, own in shown if own]
    return distinct(filter(None, said))


def _overrides(section: Any) -> list[tuple[str, list[tuple[str, str]]]]:
    return [
        (name, [(path, plain(value)) for path, value in (changes or {}).items()])
        for name, changes in (section or {}).items()
    ]


def _parameters(row: Mapping[str, Any]) -> list[str]:
    named = [text(row.get("name"))] if row.get("name") else []
    return named + [
        f"{key} = {value}" for key, value in row.items() if key not in ("label", "name") and value is not None
    ]
