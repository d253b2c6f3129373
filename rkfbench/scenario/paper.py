"""Reading a paper's file: citation, printed tables, claims, with every fault where it stands."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from rkfbench.catalogue import check
from rkfbench.errors import ScenarioError, SpecError
from rkfbench.scenario import files, yaml
from rkfbench.scenario.locate import in_order, located
from rkfbench.scenario.paper_schema import Paper


def load_paper(source: str | Path, more: Callable[[Paper], Iterable[SpecError]] | None = None) -> Paper:
    """The paper's file of a name or path. `more` finds faults that the shape does not show (names of its scenarios).

    Raises ScenarioError with all problems of the file.
    """
    path = files.find(source, files.papers(), "paper file")
    document = yaml.read(path, files.display(path))
    try:
        paper: Paper = check(Paper, document)
        faults = list(more(paper)) if more else []
    except SpecError as error:
        faults = [error]
    if faults:
        raise ScenarioError(in_order(located(document, faults)))
    return paper
