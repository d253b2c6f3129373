"""From a results folder to its tables and figures; nothing is computed anew, so no filter runs.

Figures are drawn from plain data, here or in the processes of a pool, with the same bytes; only this process writes.

A committed folder does not keep the numbers of single runs. What needs them (marks of single runs, errors of medians)
is then drawn from the CSV that was written when they were there.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from rkfbench import own
from rkfbench import scenario as scenarios
from rkfbench.pool import Pool
from rkfbench.references import is_reference
from rkfbench.report import entries, figures, forest, latex, style, tables
from rkfbench.report.captions import caption
from rkfbench.report.influence import influence_points
from rkfbench.report.material import Material, distinct
from rkfbench.report.points import Point, needs_runs, points, read_points, write_points
from rkfbench.report.verdicts import claim_of
from rkfbench.report.words import PLAIN, Words
from rkfbench.scenario import Scenario
from rkfbench.scenario.display import Figure, Forest, Influence, Table
from rkfbench.scenario.names import stem
from rkfbench.scenario.paper_schema import Paper
from rkfbench.store import Results, files, manifest

SECONDS = 0.4  # to draw a figure, about
FOREST_CAPTION = (
    "Bar: interval of the 95 % family; shaded: claimed region, with its edges. Each row has its own scale and shows "
    "the cell that decides the claim."
)


@dataclass(frozen=True)
class Picture:
    """A figure under one reading: what it says, and how to draw it."""

    figure: Figure
    reading: str
    caption: str
    points: list[Point]
    lines: list[forest.Line]
    looks: dict[str, style.Look]
    words: Words = PLAIN

    @property
    def stem(self) -> str:
        reading = files.shortened(stem(self.reading))
        return f"{self.figure.id}.{reading}" if reading else self.figure.id

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in inches of what stands above the caption."""
        if isinstance(self.figure, Forest):
            return forest.size(self.lines)
        return figures.size(figures.layout(self.figure, self.points, self.words))

    def drawn(self) -> Any:
        """The matplotlib figure (inside `style.styled()`)."""
        if isinstance(self.figure, Forest):
            return forest.draw(self.lines, self.caption)
        return figures.draw(self.figure, self.points, self.looks, self.caption, self.words)


@dataclass(frozen=True)
class Outcome:
    """A results folder with the scenario it came from and the paper that it belongs to.

    rendered: its tables are read from where `render` has written them, which takes less time than to make them.
    """

    results: Results
    scenario: Scenario
    paper: Paper | None
    rendered: bool = False

    @classmethod
    def open(cls, folder: str | Path, rendered: bool = False) -> Outcome:
        """The folder, checked against its manifest, with the scenario that is stored in it."""
        results = Results.open(folder)
        scenario = _scenario(results.folder / "scenario.yaml", results.manifest["files"].get("scenario.yaml"))
        return cls(results, scenario, scenarios.load_paper(scenario.paper) if scenario.paper else None, rendered)

    @cached_property
    def material(self) -> Material:
        cells = self.scenario.cells
        specs = [spec for cell in cells for spec in cell.spec["filters"]]
        ordinary = {spec["label"] for spec in specs if not spec.get("extra")}
        return Material(
            self.results,
            frozenset(spec["label"] for spec in specs) - ordinary,
            frozenset(cell.case for cell in cells if cell.extra),
            tuple(distinct(cell.reading for cell in cells)),
            self.paper.tables if self.paper else {},
            Words(self.scenario.names, self.scenario.caveats),
        )

    def tables(self) -> Iterator[tuple[Table, list[entries.Entry], list[tables.Sheet]]]:
        """Every declared table that has numbers, with its entries and sheets."""
        own.beside(self.scenario.plugins)  # its words ask for metrics; another scenario may have been in hand
        for table in self.scenario.tables:
            path = self.results.folder / "tables" / f"{table.id}.csv"
            kept = self.rendered or (entries.needs_runs(table) and not self.results.has_runs)
            found = entries.read(path) if kept and path.exists() else entries.of(table, self.material)
            printed = self.material.printed.get(table.paper) if table.paper else None
            if printed and not table.title:
                table = table.model_copy(update={"title": printed.title})
            if found:
                decimals = printed.decimals if printed else None
                yield table, found, tables.layouts(table, found, decimals, self.material.words)

    def pictures(self) -> Iterator[Picture]:
        """Every declared figure under each of its readings for which there are numbers."""
        own.beside(self.scenario.plugins)
        names = self.material.names
        labels = distinct([*self.material.filters, *names.values(), *(key[2] for key in self.material.summary)])
        looks = style.looks(labels, names, self._references(names))
        for figure in self.scenario.figures:
            for reading in self.material.pick_readings(figure):
                picture = self._picture(figure, reading, looks)
                if picture.points or picture.lines:
                    yield picture

    def _references(self, names: Mapping[str, str]) -> set[str]:
        """The labels of the references, and the names that stand for them where their look is asked for."""
        specs = {spec["label"]: spec for cell in self.scenario.cells for spec in cell.spec["filters"]}
        return {each for each in (*specs, *names.values()) if is_reference(specs.get(each, each))}

    def _picture(self, figure: Figure, reading: str, looks: dict[str, style.Look]) -> Picture:
        if isinstance(figure, Forest):
            there = distinct(str(row["claim"]) for row in self.results.claims)
            claims = figure.claims or (self.paper.headline if self.paper else there)
            says = [*(self.paper.claims if self.paper else []), *self.scenario.claims]
            holds = {identity: claim.holds for identity in claims if (claim := claim_of(identity, says))}
            lines = forest.lines(self.results.claims, claims, [reading], holds)
            said = [figure.title, figure.caption, FOREST_CAPTION, self.scenario.caveat(reading)]
            sentences = " ".join(f"{part.rstrip('.')}." for part in said if part)
            return Picture(figure, reading, sentences, [], lines, looks)
        words = self.material.words
        if isinstance(figure, Influence):
            specs = next(
                cell.spec["filters"] for cell in self.scenario.cells if cell.reading == reading.partition("+")[0]
            )
            curves = list(influence_points(figure, specs, reading))
            return Picture(figure, reading, caption(figure, curves, words), curves, [], looks, words)
        picture = Picture(figure, reading, "", [], [], looks)
        path = self.results.folder / "figures" / f"{picture.stem}.csv"
        kept = needs_runs(figure) and not self.results.has_runs and path.exists()
        found = read_points(path) if kept else points(figure, self.material, reading)
        return Picture(
            figure, reading, caption(figure, found, self.material.words), found, [], looks, self.material.words
        )


@lru_cache(maxsize=32)
def _scenario(path: Path, digest: str | None) -> Scenario:
    """The scenario of a file of which this is the hash: rendering and report want the same one."""
    return scenarios.load(path)


def render(folder: str | Path, pool: Pool | None = None) -> list[Path]:
    """Write tables/ and figures/ of a results folder and seal it; returns the files, in the order of the scenario."""
    outcome = Outcome.open(folder)
    written = [*_write_tables(outcome), *_write_figures(outcome, pool or Pool(1))]
    place = outcome.results.folder
    manifest.seal(place, *(path.relative_to(place).as_posix() for path in written))
    return written


def _write_tables(outcome: Outcome) -> Iterator[Path]:
    for table, found, sheets in outcome.tables():
        stem = outcome.results.folder / "tables" / table.id
        entries.write(stem.with_suffix(".csv"), found)
        files.write(stem.with_suffix(".md"), tables.markdown(table, sheets))
        files.write(stem.with_suffix(".tex"), latex.tables(table, sheets, outcome.scenario.name))
        yield from (stem.with_suffix(suffix) for suffix in (".csv", ".md", ".tex"))


def _write_figures(outcome: Outcome, pool: Pool) -> Iterator[Path]:
    place = outcome.results.folder / "figures"
    pictures = list(outcome.pictures())
    drawn = pool.ordered(_files, pictures) if pool.pays(len(pictures) * SECONDS) else map(_files, pictures)
    for picture, (png, pdf) in zip(pictures, drawn, strict=True):
        paths = {suffix: place / f"{picture.stem}{suffix}" for suffix in (".png", ".pdf", ".csv")}
        files.write(paths[".png"], png)
        files.write(paths[".pdf"], pdf)
        if picture.points:
            write_points(paths[".csv"], picture.points)
        else:
            files.write_records(paths[".csv"], forest.COLUMNS, (line.record for line in picture.lines))
        yield from paths.values()


def _files(picture: Picture) -> tuple[bytes, bytes]:
    """A picture as PNG and PDF."""
    with style.styled():
        figure = picture.drawn()
        return style.png(figure), style.pdf(figure)
