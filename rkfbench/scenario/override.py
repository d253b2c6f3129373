"""Overrides: a dotted path and the value that takes its place.

`graft` never changes what it is given: it copies the mappings along the path and shares the rest. Entries of lists are
addressed by label (`filters.hkf.threshold`). `set_value` and `add_sweep` carry out `--set` and `--sweep` by rewriting
the document, so that a stored scenario can be run again without the options that made it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rkfbench.errors import SpecError, did_you_mean
from rkfbench.own import short
from rkfbench.scenario.yaml import Map, Mark, Seq, marked


def graft(node: Map, path: str | Sequence[str], value: Any, at: Mark) -> Map:
    """`node` with `value` at `path`, standing at `at`; None removes the key. SpecError where the path leads nowhere."""
    return _graft(node, path.split(".") if isinstance(path, str) else list(path), marked(value, at), at)


def entry_name(entry: Any) -> str | None:
    """The name by which an entry of a list (a filter, a metric, a disturbance) is addressed."""
    if isinstance(entry, str):
        return str(short(entry))
    if isinstance(entry, dict):
        name = next((entry[key] for key in ("label", "id", "use", "kind") if key in entry), None)
        return short(name) if isinstance(name, str) else None
    return None


def set_value(document: Map, path: str, value: Any, at: Mark) -> Map:
    """The document in which `path` has `value`, whatever readings, switches and cases say; its sweep has one point."""
    new = graft(document, path, value, at)
    for section in ("readings", "sensitivity", "cases"):
        if isinstance(named := new.get(section), Map):
            new[section] = named.copy()
            for name, overrides in named.items():
                if isinstance(overrides, Map):
                    new[section][name] = _outranked(overrides, path, value, at)
    if isinstance(sweep := new.get("sweep"), Map):
        if any(path.startswith(swept + ".") for swept in sweep):
            raise SpecError("stands inside a part that is swept: set the whole part")
        new["sweep"] = sweep.only({key for key in sweep if not f"{key}.".startswith(f"{path}.")} | {path})
        if path in sweep:
            points = None if value is None else marked([value], at)
            new["sweep"] = _graft(new["sweep"], [path], points, at)
    return new


def add_sweep(document: Map, path: str, values: Any, at: Mark) -> Map:
    """The document with a sweep of `path`, in place of the one it may have."""
    new = document.copy() if isinstance(document.get("sweep"), Map) else graft(document, "sweep", {}, at)
    new["sweep"] = _graft(new["sweep"], [path], marked(values, at), at)
    return new


def _graft(node: Any, path: list[str], value: Any, at: Mark) -> Any:
    key, *rest = path
    if isinstance(node, Seq):
        return _graft_entry(node, key, rest, value, at)
    if not isinstance(node, Map):
        raise SpecError(f"leads nowhere: there is no '{key}' inside a single value")
    if rest and node.get(key) is None:
        raise SpecError(f"leads nowhere: there is no '{key}'{did_you_mean(key, node)}")
    new = node.copy()
    if rest:
        new[key] = _graft(node[key], rest, value, at)
    elif value is None:
        new.pop(key, None)
        new.keys_at[key] = new.values_at[key] = at
    else:
        new.put(key, value, at, at)
    return new


def _graft_entry(node: Seq, name: str, rest: list[str], value: Any, at: Mark) -> Seq:
    names = [entry_name(entry) for entry in node]
    called = [index for index, each in enumerate(names) if each == name]
    if not called:
        raise SpecError(f"leads nowhere: there is no entry '{name}'{did_you_mean(name, filter(None, names))}")
    # An entry that lists values stands for filters with labels of their own, such as hkf[threshold=2]; several such
    # entries of one name are one family, and all of them are meant.
    single = [index for index in called if not isinstance(node[index], Map) or not _lists(node[index])]
    if len(single) > 1:
        raise SpecError(f"is ambiguous: several entries are called '{name}'; give them labels")
    new = node.copy()
    for index in sorted(single or called, reverse=True):
        if rest:
            entry = node[index]  # a filter may be given by its bare name
            new[index] = _graft(marked({"use": entry}, at) if isinstance(entry, str) else entry, rest, value, at)
        elif value is None:
            del new[index], new.values_at[index]
        else:
            new[index], new.values_at[index] = value, at
    return new


def _lists(entry: Map) -> bool:
    return any(isinstance(value, Seq) for value in entry.values())


def _outranked(overrides: Map, path: str, value: Any, at: Mark) -> Map:
    """The overrides without those of `path` and what is inside it, and with `value` inside those of what holds it."""
    kept = Map(overrides.mark)
    for key, old in overrides.items():
        if f"{key}.".startswith(f"{path}."):
            continue
        if path.startswith(f"{key}."):
            old = _graft(old, path.removeprefix(f"{key}.").split("."), value, at)
        kept.put(key, old, overrides.keys_at[key], overrides.values_at[key])
    return kept
