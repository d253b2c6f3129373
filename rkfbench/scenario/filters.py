"""The `filters:` of a scenario: labels, and one filter for each value of a list.

    - kf                                                        a name
    - {use: hkf, threshold: [0.5, 2], extra: true}              two filters, hkf[threshold=0.5] and hkf[threshold=2]
    - {moments: cubature, weight: {huber: {threshold: 1}}, label: hckf}      a choice of parts
    - {fixed_point: {filter: mckf, at: 900, lag: 100}, label: mcs}           a filter around another one

`label`, `extra`, `timing` and `assumed` belong to the scenario; what remains is what `rkfbench.filters.build` reads.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, get_args, get_origin

from pydantic import Field

from rkfbench.catalogue import Entry, check, find, parameters
from rkfbench.errors import SpecError
from rkfbench.filters import FILTERS
from rkfbench.own import short
from rkfbench.scenario.defaults import PARTS
from rkfbench.scenario.display import Strict
from rkfbench.scenario.estimates import within
from rkfbench.scenario.override import graft
from rkfbench.scenario.schema import FilterAssumed, fault_of
from rkfbench.scenario.yaml import Map, Mark, Seq, marked


class Head(Strict):
    """What the scenario says about a filter beside what it is."""

    label: str = Field(default="", min_length=1, description="name in all results; default: the filter's own name")
    extra: bool = Field(default=False, description="only in the full study")
    timing: bool = Field(default=False, description="only timed, for a table of computing times; not in the study")
    assumed: FilterAssumed = Field(default=FilterAssumed(), description="what this filter is told differently")


MOST_FILTERS = 1000  # of a cell
HEAD = tuple(Head.model_fields)


def expanded(filters: Seq) -> Seq:
    """One labelled mapping a filter, with marks. SpecError with the index of each entry at fault."""
    new = Seq(filters.mark)
    faults: list[SpecError] = []
    labels: set[str] = set()
    for index, (written, at) in enumerate(zip(filters, filters.values_at, strict=True)):
        try:
            entry = _entry(written, at)
            check(Head, {key: entry[key] for key in HEAD if key in entry})
            if any(isinstance(each.get("file"), list) for each in within(entry)):
                raise SpecError("`file` is one file: give each a filter with a label of its own")
            for each in _each_value(entry, at):
                if fault := fault_of(each["label"]):
                    raise SpecError(fault, ("label",))
                if each["label"] in labels:
                    raise SpecError(f"two filters are labelled '{each['label']}': give one of them another label")
                if len(labels) == MOST_FILTERS:
                    raise SpecError(f"there are more than {MOST_FILTERS} filters with those that its lists make")
                labels.add(each["label"])
                new.add(each, at)
        except SpecError as error:
            faults.append(error.under(index))
            if len(labels) == MOST_FILTERS:
                break
    if faults:
        raise SpecError.all(faults)
    return new


def description(entry: Mapping[str, Any]) -> dict[str, Any]:
    """What of a labelled filter is its build specification."""
    return {key: value for key, value in entry.items() if key not in HEAD}


def _entry(written: Any, at: Mark) -> Map:
    """The entry as a mapping with a label."""
    if isinstance(written, str):
        written = marked({"use": written}, at)
    if not isinstance(written, Map):
        raise SpecError("a filter is a name or a mapping such as {use: hkf, threshold: 2}")
    if "label" in written:
        return written
    name = short(written.get("use") or next((key for key in written if find(FILTERS, key)), None))
    if not isinstance(name, str):
        raise SpecError("needs a label, because it has no name of its own")
    return graft(written, "label", name, at)


def _each_value(entry: Map, at: Mark) -> Iterator[Map]:
    """The entry once for each combination of the values that its scalar parameters list."""
    listed = list(_listed(entry))
    for values in product(*(values for _, values in listed)):
        each = entry
        for (path, _), (value, place) in zip(listed, values, strict=True):
            each = graft(each, path, value, place)
        if listed:
            shown = ",".join(f"{path[-1]}={value}" for (path, _), (value, _) in zip(listed, values, strict=True))
            each = graft(each, "label", f"{entry['label']}[{shown}]", at)
        yield each


def _listed(spec: Any) -> Iterator[tuple[tuple[str, ...], list[tuple[Any, Mark]]]]:
    """Path and (value, mark) pairs of every scalar parameter that is given as a list."""
    for path, entry, params in _entries(spec):
        for name, parameter in parameters(entry.make).items():
            if isinstance(values := params.get(name), Seq) and values and not _takes_list(parameter.annotation):
                yield (*path, name), list(zip(values, values.values_at, strict=True))


def _entries(spec: Any) -> Iterator[tuple[tuple[str, ...], Entry, Map]]:
    """The catalogue entries in a filter's specification: path of its parameters, entry, parameters."""
    if not isinstance(spec, Map):
        return
    if entry := find(FILTERS, spec.get("use")):
        yield (), entry, spec
    for part, catalogue in PARTS.items():
        if isinstance(chosen := spec.get(part), Map):
            for name, params in chosen.items():
                if isinstance(params, Map) and (entry := find(catalogue, name)):
                    yield (part, name), entry, params
    for name, params in spec.items():
        if name not in (*PARTS, *HEAD) and isinstance(params, Map) and (entry := find(FILTERS, name)):
            yield (name,), entry, params
            for path, entry, inner in _entries(params.get("filter")):
                yield (name, "filter", *path), entry, inner


def _takes_list(annotation: Any) -> bool:
    """Whether a list is a value of this type (and so not a list of values)."""
    if get_origin(annotation) is Annotated:
        return _takes_list(get_args(annotation)[0])
    origin = get_origin(annotation) or annotation
    if origin in (list, tuple, Any):
        return True
    return any(_takes_list(inner) for inner in get_args(annotation))
