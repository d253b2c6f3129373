"""Descriptions with every default of the catalogues written out, as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rkfbench.catalogue import Entry, find, parameters
from rkfbench.filters import FILTERS, MOMENTS, SCHEMES, WEIGHTS
from rkfbench.models import MODELS
from rkfbench.models.truths import TRUTHS
from rkfbench.noise import LAWS
from rkfbench.noise.disturbances import DISTURBANCES
from rkfbench.scenario.yaml import plain

PARTS: dict[str, Mapping[str, Entry]] = {"moments": MOMENTS, "weight": WEIGHTS, "update": SCHEMES}
KINDS: dict[str, Mapping[str, Entry]] = {
    "model": MODELS,
    "truth": TRUTHS,
    "process_noise": LAWS,
    "measurement_noise": LAWS,
    "disturbances": DISTURBANCES,
}


def completed_kinds(spec: Mapping[str, Any]) -> dict[str, Any]:
    """The sections of a cell that are written as `{kind: name, ...}`."""
    return {key: completed_kind(catalogue, spec[key]) for key, catalogue in KINDS.items() if key in spec}


def completed_kind(catalogue: Mapping[str, Entry], spec: Any) -> Any:
    """`{kind: name, ...}`, and whatever is written so inside it."""
    if isinstance(spec, Mapping):
        inner = {key: completed_kind(catalogue, value) for key, value in spec.items()}
        return {"kind": inner.get("kind"), **defaults(catalogue, inner["kind"]), **inner} if "kind" in inner else inner
    if isinstance(spec, list):
        return [completed_kind(catalogue, each) for each in spec]
    return spec


def completed_filter(spec: Any) -> Any:
    """A filter in any of its forms: a name, `{use: name}`, a choice of parts, a filter around a filter."""
    if isinstance(spec, str):
        spec = {"use": spec}
    if not isinstance(spec, Mapping):
        return spec
    new = plain(spec)
    if "use" in new:
        new = {"use": new["use"], **defaults(FILTERS, new["use"]), **new}
    for part, catalogue in PARTS.items():
        if part in new:
            new[part] = _completed_part(catalogue, new[part])
    for name in new.keys() - PARTS.keys() - {"assumed"}:
        if isinstance(new[name], dict) and find(FILTERS, name):
            new[name] = {**defaults(FILTERS, name), **new[name]}
            if "filter" in new[name]:
                new[name]["filter"] = completed_filter(new[name]["filter"])
    return new


def defaults(catalogue: Mapping[str, Entry], name: Any) -> dict[str, Any]:
    """The default of every parameter that has one; None stands for a parameter left out. Unknown names have none."""
    if (entry := find(catalogue, name)) is None:
        return {}
    given = {key: each.default for key, each in parameters(entry.make).items() if each.default is not None}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in given.items()}


def _completed_part(catalogue: Mapping[str, Entry], chosen: Any) -> Any:
    """`name` or `{name: {parameters}}`."""
    name, params = next(iter(chosen.items())) if isinstance(chosen, dict) and len(chosen) == 1 else (chosen, {})
    if not isinstance(params, dict):
        return chosen
    full = {**defaults(catalogue, name), **params}
    return {name: full} if full else name
