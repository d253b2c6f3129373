"""The catalogue of filters and of the parts they are made of, and how one is built.

build("hkf", threshold=2)
build({"moments": "taylor", "weight": {"huber": {"threshold": 1.345}}, "update": "once"})
build({"fixed_point": {"filter": "hkf", "at": 50, "lag": 20}})
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rkfbench.catalogue import Entry, find, lookup
from rkfbench.catalogue import build as _build
from rkfbench.errors import SpecError
from rkfbench.filters.base import Estimate, Filter, Known, Setting
from rkfbench.filters.entries import FILTERS, MOMENTS, SCHEMES, WEIGHTS
from rkfbench.filters.gaussian import GaussianFilter
from rkfbench.filters.smoothing import placed

__all__ = [
    "FILTERS",
    "MOMENTS",
    "SCHEMES",
    "WEIGHTS",
    "Estimate",
    "Filter",
    "GaussianFilter",
    "Known",
    "Setting",
    "build",
    "placed",
]

FORMS = "a filter is a name, {use: name, ...} or {moments:, weight:, update:}"
_PARTS = {
    "moments": (MOMENTS, "moment rule"),
    "weight": (WEIGHTS, "robust weight"),
    "update": (SCHEMES, "update scheme"),
}


def build(spec: str | Mapping[str, Any], **params: Any) -> Filter:
    """The filter that a name with parameters, `{use: name, **parameters}`, `{name: {**parameters}}` or `{moments:,
    weight:, update:}` describes.

    Raises SpecError with the path of each fault.
    """
    if isinstance(spec, str):
        return _make(FILTERS, "filter", spec, params)
    if not isinstance(spec, Mapping):
        raise SpecError(FORMS)
    description = {**spec, **params}
    if "use" in description:
        name = description.pop("use")
        return _make(FILTERS, "filter", name, description, at="use")
    if (
        len(description) == 1
        and isinstance(description[name := next(iter(description))], Mapping)
        and find(FILTERS, name)
    ):
        try:
            return _make(FILTERS, "filter", name, description[name])
        except SpecError as error:
            raise error.under(name) from None
    if not description or description.keys() - _PARTS.keys():
        unknown = sorted(description.keys() - _PARTS.keys())
        raise SpecError(FORMS, unknown[:1])
    return GaussianFilter(**{part: _part(part, value) for part, value in description.items()})


def _make(catalogue: Mapping[str, Entry], what: str, name: Any, params: Mapping[str, Any], at: str = "") -> Any:
    try:
        lookup(catalogue, what, name)
    except SpecError as error:
        raise error.under(*([at] if at else [])) from None
    return _build(catalogue, what, name, params)


def _part(part: str, value: Any) -> Any:
    """A part written as `name` or `{name: {parameters}}`."""
    catalogue, what = _PARTS[part]
    if isinstance(value, Mapping) and len(value) == 1:
        name, params = next(iter(value.items()))
    else:
        name, params = value, {}
    try:
        return _build(catalogue, what, name, params or {})
    except SpecError as error:
        raise error.under(part, *([name] if params and isinstance(name, str) else [])) from None
