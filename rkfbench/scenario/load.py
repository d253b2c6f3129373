"""From a file to a checked Scenario: read, rewrite by the options, check the shape, make the cells, check each cell.

All problems of a file are told at once, each where it stands: an error in a value that came from a reading points at
the line of the reading, one that came from an option names the option.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from functools import cache
from pathlib import Path as FilePath
from typing import Any

from rkfbench import own
from rkfbench.catalogue import check
from rkfbench.errors import Path, Problem, ScenarioError, SpecError, UsageError
from rkfbench.scenario import attached, files, yaml
from rkfbench.scenario.check import SECTIONS, Checker
from rkfbench.scenario.defaults import completed_filter, completed_kinds
from rkfbench.scenario.estimates import placed, with_estimates
from rkfbench.scenario.expand import between, columns, drafts
from rkfbench.scenario.locate import in_order, located
from rkfbench.scenario.names import twins, unknown_names
from rkfbench.scenario.override import add_sweep, graft, set_value
from rkfbench.scenario.paper import load_paper
from rkfbench.scenario.paper_schema import Paper
from rkfbench.scenario.scenario import Cell, Scenario
from rkfbench.scenario.schema import META, Citation, Runs, ScenarioFile
from rkfbench.scenario.yaml import Map, Mark

MOST_FILTERED = 20_000  # filters of all cells together; each is made once to check it

Rewrite = Callable[[Map, str, Any, Mark], Map]


def load(
    source: str | FilePath,
    *,
    sets: Sequence[str] = (),
    sweeps: Sequence[str] = (),
    runs: int | None = None,
    seed: int | None = None,
    estimates: Mapping[str, FilePath] | None = None,
) -> Scenario:
    """The scenario of a file or a bundled name, rewritten by options `path=value` and `path=0:1:5`.

    `estimates` are files of filters written elsewhere, by label. Raises ScenarioError with all problems of the file.
    """
    path = files.find(source, files.bundled(), "scenario")
    document = yaml.read(path, files.display(path))
    problems: list[Problem] = []
    document = _with_options(document, sets, sweeps, runs, seed, problems)
    document = attached.absolute(with_estimates(document, estimates or {}), path.parent)
    plugins = path.absolute().parent / str(document.get("plugins") or "")
    own.beside(plugins)
    file = _checked(document, problems)
    cells = [_pinned(cell, plugins) for cell in _cells(document, problems)]
    if file is not None and not problems:
        for fault, place in twins(file):
            problems += located(document, [fault], *place)
        file = _with_runs(file, document, cells, problems)
        faults = list(unknown_names(file, cells, columns(list(file.sweep)), _paper(file, document)))
        if file.claims:
            faults += _unknown_to_claims(file, document, cells, problems)
        if sets or sweeps:  # what they have removed is not shown
            document, file = _without(document, file, {each.path[:2] for each in faults})
        else:
            problems += located(document, faults)
    if problems or file is None:
        raise ScenarioError(in_order(problems))
    cells = placed(cells, file.runs.paper)
    resolved, copies = _resolved(document, file)
    return Scenario(
        name=file.name,
        title=file.title,
        paper=file.paper if isinstance(file.paper, str) else None,
        citation=file.paper if isinstance(file.paper, Citation) else None,
        notes=file.notes,
        names=file.names,
        caveats={name: reading.caveat for name, reading in file.readings.items() if reading.caveat},
        seed=file.seed,
        runs=file.runs.paper,
        paper_runs=file.runs.paper,
        reference_runs=file.runs.reference,
        file=files.display(path),
        plugins=plugins,
        columns=tuple(columns(list(file.sweep))),
        cells=tuple(cell for cell in cells if cell.switch is None),
        sensitivity=tuple(cell for cell in cells if cell.switch is not None),
        tables=tuple(file.tables),
        figures=tuple(file.figures),
        claims=tuple(file.claims),
        resolved=resolved,
        copies=copies,
    )


@cache
def load_bundled(name: str) -> Scenario:
    """A bundled scenario as it stands in its file, which is read once."""
    return load(name)


def _with_runs(file: ScenarioFile, document: Map, cells: Sequence[Cell], problems: list[Problem]) -> ScenarioFile:
    """The file with all recorded runs, where it does not say how many; what it says may not be more."""
    recorded = attached.recorded_runs(cells)
    if recorded is None:
        return file
    if "runs" not in document:
        return file.model_copy(update={"runs": Runs(paper=recorded, reference=recorded)})
    if max(file.runs.paper, file.runs.reference) > recorded:
        what = "recording is" if recorded == 1 else "recordings are"
        problems += located(document, [SpecError(f"only {recorded} {what} there", ("runs",))])
    return file


def _with_options(
    document: Map,
    sets: Sequence[str],
    sweeps: Sequence[str],
    runs: int | None,
    seed: int | None,
    problems: list[Problem],
) -> Map:
    """The document rewritten by the options of the command line."""
    options: list[tuple[str, str, Rewrite, Callable[[str, Mark], Any]]] = []
    options += [("--sweep", each, add_sweep, _sweep_values) for each in sweeps]
    options += [("--set", each, set_value, yaml.parse_value) for each in sets]
    for option, text, rewrite, read in options:
        mark = Mark(f"{option} {text}")
        path, equals, value = text.partition("=")
        try:
            if not equals or not path:
                raise SpecError("should be written as path=value")
            text.encode()  # what a command line gives may not be UTF-8
            if option == "--set" and (swept := _swept(path.strip(), sweeps)):
                raise SpecError(f"stands against --sweep {swept}, which gives it other values: leave out one of them")
            document = rewrite(document, path.strip(), read(value, mark), mark)
        except SpecError as error:
            problems.append(mark.problem(error.message, path if equals else ""))
        except UnicodeEncodeError:
            problems.append(mark.problem("is not UTF-8 text"))
        except ScenarioError as error:
            problems += error.problems
    if runs is not None:
        both = yaml.marked({"paper": runs, "reference": runs}, Mark(f"--runs {runs}"))
        document = graft(document, "runs", both, Mark(f"--runs {runs}"))
    if seed is not None:
        document = graft(document, "seed", seed, Mark(f"--seed {seed}"))
    return document


def _swept(path: str, sweeps: Sequence[str]) -> str:
    """The option that sweeps `path` or something in it; "" where there is none."""
    return next((each for each in sweeps if f"{each.partition('=')[0].strip()}.".startswith(f"{path}.")), "")


def _sweep_values(text: str, mark: Mark) -> list[Any]:
    """`0.5:3:6` (first, last, count) or `a,b,c`."""
    if text.count(":") == 2:
        first, last, count = (yaml.parse_value(part, mark) for part in text.split(":"))
        if isinstance(count, int) and all(type(end) in (int, float) for end in (first, last)):
            return between(first, last, count)
        raise SpecError("should be written as path=first:last:count or path=a,b,c")
    return [yaml.parse_value(part, mark) for part in text.split(",")]


def _checked(document: Map, problems: list[Problem]) -> ScenarioFile | None:
    """The file as the schema sees it. Readings, cases and sweeps that are broken are left out of the document."""
    try:
        file: ScenarioFile = check(ScenarioFile, document)
        return file
    except SpecError as error:
        problems += located(document, [error])
        for key in ("readings", "sensitivity", "cases", "sweep"):
            if any(each.path[:1] == (key,) for each in error):
                document.pop(key, None)
        return None


def _paper(file: ScenarioFile, document: Map) -> Paper | None:
    if not isinstance(file.paper, str):
        return None
    try:
        return load_paper(file.paper)
    except ScenarioError:
        raise
    except UsageError as error:
        raise ScenarioError(list(located(document, [SpecError(str(error), ("paper",))]))) from None


def _unknown_to_claims(
    file: ScenarioFile, document: Map, cells: Sequence[Cell], problems: list[Problem]
) -> Iterator[SpecError]:
    """The names that the file's claims use and nothing has; what else is wrong with them is added to `problems`."""
    from rkfbench.claims.checks import checks_of  # late, as the claims are made of parts of this package
    from rkfbench.claims.plan import outline, own_paper, unknown, unwritten

    judged = [cell for cell in cells if cell.switch is None]
    checks = checks_of(file.paper) if isinstance(file.paper, str) else ()
    paper, outlines = own_paper(file.name, file.claims), {file.name: outline(judged, file.runs.paper, checks)}
    problems += located(document, unwritten(paper, outlines))
    yield from unknown(paper, outlines)


def _without(document: Map, file: ScenarioFile, items: Set[Path]) -> tuple[Map, ScenarioFile]:
    """The document and the file without some of their tables, figures and claims."""
    new, kept = document.copy(), {}
    for section in ("tables", "figures", "claims"):
        keep = [index for index in range(len(getattr(file, section))) if (section, index) not in items]
        kept[section] = [getattr(file, section)[index] for index in keep]
        if section in document:
            new[section] = [document[section][index] for index in keep]
    return new, file.model_copy(update=kept)


def _cells(document: Map, problems: list[Problem]) -> Iterator[Cell]:
    """The cells that make sense; the problems of the others are added to `problems`."""
    faults: list[tuple[SpecError, Path]] = []
    checked = Checker()
    base, _, wrong = checked(document.only(SECTIONS))
    problems += located(base, wrong)
    switches: set[str] = set()
    count = 0
    for draft in drafts(document, SECTIONS, faults):
        # A switch is tried at its first point only: the other points have been tried without it.
        listed, spec, wrong = checked(draft.spec, whole=draft.switch not in switches)
        if draft.switch is not None:
            switches.add(draft.switch)
        problems += located(listed, wrong)
        if spec is not None:
            count += len(spec["filters"])
            yield Cell(draft.reading, draft.case, dict(draft.point), draft.switch, draft.extra, spec)
        if count > MOST_FILTERED:
            faults.append((SpecError(f"the filters of all cells are more than {MOST_FILTERED}"), ("filters",)))
            break
    for fault, place in faults:
        problems += located(document, [fault], *place)


def _pinned(cell: Cell, plugins: FilePath) -> Cell:
    """The cell with the hashes of its recorded data and of the plug-ins that it names, which must not change while
    they are used.
    """
    spec = attached.pinned(cell.spec)
    if sources := own.pins(spec):
        spec["plugins"] = {"folder": str(plugins), "sources": sources}
    return replace(cell, spec=spec)


def _resolved(document: Map, file: ScenarioFile) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The document with every default written out, but for parts whose kind an override changes; and the files of its
    plug-ins.
    """
    written = yaml.plain(document)
    settings = yaml.plain(file.model_dump(include={"name", "seed", "runs", *SECTIONS}, exclude_none=True))
    overridden = [*document.get("sweep", {})]
    for section in ("readings", "sensitivity", "cases"):
        overridden += [path for overrides in document.get(section, {}).values() for path in overrides]
    rekinded = {path.split(".")[0] for path in overridden if path.endswith((".kind", ".use"))}
    complete = completed_kinds(document) | {"filters": [completed_filter(each) for each in document["filters"]]}
    full = {**written, **settings, **complete} | {key: written[key] for key in rekinded}
    full.pop("plugins", None)
    if copies := own.copies(full):
        full["plugins"] = own.COPIES
    return {key: full[key] for key in (*META, *ScenarioFile.model_fields) if key in full}, copies
