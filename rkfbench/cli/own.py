"""The commands about own filters: check one against the contract, write the start of one."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from rkfbench.cli.common import command
from rkfbench.cli.terminal import Terminal


class What(StrEnum):
    filter = "filter"
    scenario = "scenario"


def add_to(app: typer.Typer) -> None:
    """Add the commands of this file."""
    for each in (check, new):
        app.command()(each)


@command
def check(
    terminal: Terminal,
    name: Annotated[str, typer.Argument(metavar="NAME", help="module:name or PATH.py:name, as in a scenario.")],
    sets: Annotated[
        list[str], typer.Option("--set", metavar="PARAMETER=VALUE", help="A parameter of the filter.")
    ] = [],
    on: Annotated[
        str | None, typer.Option("--on", metavar="SCENARIO", help="Try it on the first case of this scenario.")
    ] = None,
) -> None:
    """Check an own filter against the contract that every filter of the catalogue keeps.

    Exit code 1 when something is found.
    """
    from functools import partial

    from rkfbench import contract, own
    from rkfbench.catalogue import lookup
    from rkfbench.errors import UsageError
    from rkfbench.filters import FILTERS, build
    from rkfbench.scenario import load
    from rkfbench.scenario.yaml import Mark, parse_value, plain

    on_problems = contract.problems()
    if on is not None:
        scenario = load(on)
        on_problems = (contract.problem_of(scenario.name, scenario.cells[0].spec),)
    home, colon, attribute = (name, "", "") if name.endswith(".py") else name.rpartition(":")
    own.beside(Path(home).parent if home.endswith(".py") else Path())
    known_as = f"{Path(home).name}{colon}{attribute}" if home.endswith(".py") else name
    entry = lookup(FILTERS, "filter", known_as)
    params: dict[str, Any] = {}
    for option in sets:
        key, equals, value = option.partition("=")
        if not equals:
            raise UsageError(f"--set {option}: should be written as PARAMETER=VALUE")
        params[key.strip()] = plain(parse_value(value, Mark(f"--set {option}")))
    make = partial(build, known_as, **params)
    results = list(contract.results(make, entry.limits, "streams" in entry.needs, on_problems))
    for limit in contract.limits_of(make(), on_problems[0]):
        terminal.note(f"{known_as}: {limit}")
    findings = [(each, text) for each in results for text in each.findings]
    if terminal.json:
        terminal.object([vars(each) for each in results])
    else:
        for each, text in findings:
            terminal.data(f"{known_as} on {each.problem}, {each.check}: {text}")
        for problem in dict.fromkeys(each.problem for each in results):
            passed = sum(each.problem == problem and not each.findings for each in results)
            terminal.data(f"{known_as} on {problem}: {passed} checks passed")
    if not results:
        served = ", ".join(problem.name for problem in on_problems)
        terminal.error(f"{known_as} can run on none of {served}: name a scenario that it serves with --on")
    if findings or not results:
        raise typer.Exit(1)


@command
def new(
    terminal: Terminal,
    what: Annotated[What, typer.Argument(help="filter: NAME.py and a scenario that runs it; scenario: NAME.yaml.")],
    name: Annotated[str, typer.Argument(help="Its name.")],
    batch: Annotated[bool, typer.Option("--batch", help="A filter of all runs at once, not of one run.")] = False,
) -> None:
    """Write the start of an own filter or scenario into the current folder; never over an existing file."""
    from rkfbench.errors import UsageError
    from rkfbench.own import templates
    from rkfbench.store import files

    texts = templates.own_filter(name, batch) if what == What.filter else templates.scenario(name)
    if taken := [each for each in texts if Path(each).exists()]:
        raise UsageError(f"{', '.join(taken)} there already: nothing is written over, choose another name")
    for path, text in texts.items():
        files.write(Path(path), text)
        terminal.data(path)
    if what == What.filter:
        terminal.note(f"next: rkfbench check {name}.py:{name}, then rkfbench run {name}.yaml")
    else:
        terminal.note(f"next: rkfbench run {next(iter(texts))}")
