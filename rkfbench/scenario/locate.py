"""Where in a file a fault stands, and how its path is written for the reader."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

from rkfbench.errors import Key, Path, Problem, SpecError
from rkfbench.scenario.override import entry_name
from rkfbench.scenario.yaml import Map, Mark, Seq


def located(root: Map, faults: Iterable[SpecError], *place: Key) -> Iterator[Problem]:
    """Each fault with the place in the file where its path ends; at the key of `place`, where that is given."""
    for each in chain.from_iterable(faults):
        path = (*place, *each.path)
        mark = locate(root, path, at_key=bool(place) or each.message.startswith("unknown key"))
        yield mark.problem(each.message, shown(root, path))


def in_order(problems: Iterable[Problem]) -> list[Problem]:
    """Every problem once, from the top of the file to its end."""
    return sorted(dict.fromkeys(problems), key=lambda problem: (problem.file, problem.line, problem.column))


def shown(root: Any, path: Path) -> str:
    """The path as the user writes it: entries of lists by their name."""
    names, node = [], root
    for key in path:
        try:
            node = node[key]
        except (KeyError, IndexError, TypeError):
            node = None
        names.append(entry_name(node) or str(key) if isinstance(key, int) and isinstance(node, dict) else str(key))
    return ".".join(names)


def locate(root: Map | Seq, path: tuple[Key, ...], at_key: bool = False) -> Mark:
    """Where the value at `path` stands (or its last key); for what is missing, where it was removed or should stand."""
    mark: Mark = root.mark
    node: Any = root
    for depth, key in enumerate(path):
        if isinstance(node, Map) and key in node.keys_at:
            last = depth == len(path) - 1
            mark = node.keys_at[str(key)] if key not in node or (last and at_key) else node.values_at[str(key)]
            node = node.get(str(key))
        elif isinstance(node, Seq) and isinstance(key, int) and key < len(node):
            mark, node = node.values_at[key], node[key]
        else:
            break
    return mark
