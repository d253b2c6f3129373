"""From the claims of a paper to cells: one estimand, one region, one scenario, one reading. Needs no result.

`problems` says what claims ask for that the scenarios do not have. `plan` makes the cells, in the order of the file.
`family_sizes` counts what is judged together; the paper's file holds these counts, frozen, and `family_problems` says
where they differ, so that no claim enters or leaves a family unseen.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from rkfbench.claims.forms import Form, forms
from rkfbench.errors import SpecError, did_you_mean
from rkfbench.scenario.advice import not_measured
from rkfbench.scenario.claims import Claim, Part, Role, names_used
from rkfbench.scenario.paper_schema import Paper
from rkfbench.times import FORMS

if TYPE_CHECKING:
    from rkfbench.scenario.scenario import Cell as Condition

Family = Literal["primary", "extra", "timing", "exact", "none"]


@dataclass(frozen=True)
class Outline:
    """What a scenario offers to claims: the names of its readings (first: headline), cases, filters and metrics."""

    readings: tuple[str, ...]
    cases: tuple[str, ...]
    filters: tuple[str, ...]
    metrics: tuple[str, ...]
    checks: tuple[str, ...] = ()
    paper_runs: int = 100

    def shown(self, reading: str) -> str:
        """The reading of this scenario that one sees under a reading of the paper: the same, or the first."""
        return reading if reading in self.readings else self.readings[0]


Outlines = Mapping[str, Outline]


def outline(cells: Sequence[Condition], paper_runs: int, checks: Iterable[str] = ()) -> Outline:
    """What a scenario offers: all of its cells, both tiers, filters that are only timed too, and the metrics that are
    one number a run.

    Left out are curves (`rmse@k`) and metrics whose summary is no mean over the runs (`pooled_rmse`; claims write
    `metric: rmse, statistic: rms` for it).
    """
    from rkfbench import metrics

    def unique(names: Iterable[str]) -> tuple[str, ...]:
        return tuple(dict.fromkeys(names))

    def is_number(name: str) -> bool:
        metric = metrics.get(name)
        return not metric.curve and not metric.root

    return Outline(
        readings=unique(cell.reading for cell in cells),
        cases=unique(cell.case for cell in cells),
        filters=unique(each["label"] for cell in cells for each in cell.spec["filters"]),
        metrics=unique(name for cell in cells for name in cell.spec["metrics"] if is_number(name)),
        checks=tuple(checks),
        paper_runs=paper_runs,
    )


@dataclass(frozen=True)
class Cell:
    """One verdict to be computed. `id` is the id of its claim, with the row and column of a printed table filled in."""

    id: str
    claim: Claim
    role: Role
    kind: str
    reading: str
    family: Family
    form: Form
    start: str = ""  # of a cell under a sensitivity switch: the reading that the switch starts from

    @property
    def key(self) -> tuple[str, str, str, str, str, str]:
        """What identifies the cell among stored rows: claim, role, kind, estimand, scenario, reading."""
        return (self.id, self.role, self.kind, self.form.text, self.form.scenario, self.reading)


def plan(paper: Paper, outlines: Outlines) -> tuple[Cell, ...]:
    """All cells of a paper's claims under all readings, in the order of the file.

    Raises SpecError, with the paths of all faults in the paper's file, if a claim asks for what is not there.
    """
    found = list(problems(paper, outlines))
    if found:
        raise SpecError.all(found)
    return tuple(_cells(paper, outlines))


def faults(paper: Paper, outlines: Outlines) -> Iterator[SpecError]:
    """Everything that is wrong with a paper's claims: unknown names, or else frozen family sizes that do not fit."""
    found = list(problems(paper, outlines))
    yield from found or family_problems(paper, tuple(_cells(paper, outlines)), outlines)


def own_paper(name: str, claims: Sequence[Claim]) -> Paper:
    """The claims of a user's scenario as a paper of their own: a family without a frozen size.

    They have been read, and are not checked again: an id that stands twice is told where it stands.
    """
    return Paper.model_construct(cite=name, scenarios=[name], claims=list(claims))


def problems(paper: Paper, outlines: Outlines) -> Iterator[SpecError]:
    """Every name that the paper's scenarios do not have, and every measurement that cannot be written out."""
    for i, scenario in enumerate(paper.scenarios):
        if scenario not in outlines:
            yield SpecError(f"unknown scenario '{scenario}'{did_you_mean(scenario, outlines)}", ("scenarios", i))
    for name, selection in paper.select.items():
        filters = {each for outline in outlines.values() for each in outline.filters}
        for j, each in enumerate(selection.filters):
            if each not in filters:
                yield _unknown("filter", each, filters).under("select", name, "from", j)
    yield from unwritten(paper, outlines)
    yield from unknown(paper, outlines)


def unwritten(paper: Paper, outlines: Outlines) -> Iterator[SpecError]:
    """Every measurement of a claim that cannot be written out, whatever its names stand for."""
    for i, claim in enumerate(paper.claims):
        for path, _, part in claim.parts():
            for error in _part_problems(paper, part, outlines):
                yield error.under("claims", i, *path, part.kind)


def unknown(paper: Paper, outlines: Outlines) -> Iterator[SpecError]:
    """Every name in a claim that its scenario does not have."""
    for i, claim in enumerate(paper.claims):
        for scenario in paper.scenarios:
            if scenario in outlines:
                for error in _name_problems(paper, claim, scenario, outlines[scenario]):
                    yield error.under("claims", i)


def _part_problems(paper: Paper, part: Part, outlines: Outlines) -> Iterator[SpecError]:
    """What is wrong with one measurement apart from the names that it picks."""
    named = getattr(part.body, "scenario", None)
    if named is not None and named not in paper.scenarios:
        yield _unknown("scenario", named, paper.scenarios).under("scenario")
        return
    try:
        written = forms(paper, part)
    except SpecError as error:
        yield error
        return
    for form in written:
        outline = outlines.get(form.scenario)
        if outline and form.check and form.check not in outline.checks:
            yield _unknown("check", form.check, outline.checks).under("check")
        if outline and form.printed and form.estimand:
            (point,) = form.estimand.points
            for kind, expression in (("filter", point.filter), ("case", point.case), ("metric", point.metric)):
                for name in expression.names():
                    if name not in _known(paper, outline, kind):
                        absent = _unknown(kind, name, _known(paper, outline, kind))
                        yield SpecError(f"{form.text}: {absent.message}", ("table",))


def _name_problems(paper: Paper, claim: Claim, scenario: str, outline: Outline) -> Iterator[SpecError]:
    for named, use in names_used(claim):
        if (named or paper.scenarios[0]) != scenario:
            continue
        known = _known(paper, outline, use.kind)
        if use.name in known:
            continue
        if use.kind == "case" and not use.name:
            yield SpecError(f"`cases` is missing; the scenario has {', '.join(outline.cases[:8])}", use.path[:-1])
        else:
            yield _unknown(use.kind, use.name, known).under(*use.path)


def _known(paper: Paper, outline: Outline, kind: str) -> tuple[str, ...]:
    return {
        "reading": outline.readings,
        "case": (*outline.cases, *paper.groups),
        "filter": (*outline.filters, *paper.groups, *paper.select),
        "metric": (*outline.metrics, "lost", "failed", *FORMS, *paper.groups),
    }[kind]


def _unknown(kind: str, name: str, known: Iterable[str]) -> SpecError:
    advice = not_measured if kind == "metric" else did_you_mean
    return SpecError(f"unknown {kind} '{name}'{advice(name, known)}")


def _cells(paper: Paper, outlines: Outlines) -> Iterator[Cell]:
    for claim in paper.claims:
        for _, role, part in claim.parts():
            for form in forms(paper, part):
                identity = claim.id.replace("{row}", form.row).replace("{column}", form.column)
                readings = outlines[form.scenario].readings
                for reading in getattr(part.body, "readings", None) or readings:
                    yield Cell(identity, claim, role, part.kind, reading, _family(claim, form), form)


def _family(claim: Claim, form: Form) -> Family:
    """With which cells one is judged; what stands beside is judged as strictly, and not counted."""
    if form.check:
        return "exact"
    if form.estimand is None:
        return "none"
    if form.estimand.timing:
        return "timing"
    return "extra" if claim.extra else "primary"


def family_sizes(paper: Paper, cells: Sequence[Cell], outlines: Outlines, family: Family = "primary") -> dict[str, int]:
    """{reading: number of deciding cells one sees under it}: what the paper's file holds as `family`.

    Under a reading one sees the cells of this reading and, from scenarios that do not have it, those of their first.
    """
    readings = dict.fromkeys(reading for name in paper.scenarios for reading in outlines[name].readings)
    counted = [cell for cell in cells if cell.family == family and cell.role == "decides"]
    return {
        seen: sum(cell.reading == outlines[cell.form.scenario].shown(seen) for cell in counted) for seen in readings
    }


def family_problems(paper: Paper, cells: Sequence[Cell], outlines: Outlines) -> Iterator[SpecError]:
    """Where the frozen sizes in the paper's file differ from the claims that stand there."""
    sizes = family_sizes(paper, cells, outlines)
    for reading, size in sizes.items():
        if reading not in paper.family:
            yield SpecError(f"reading '{reading}' is missing; its claims have {size} cells", ("family",))
        elif paper.family[reading] != size:
            yield SpecError(f"the claims have {size} cells, not {paper.family[reading]}", ("family", reading))
    for reading in paper.family:
        if reading not in sizes:
            yield _unknown("reading", reading, sizes).under("family", reading)
