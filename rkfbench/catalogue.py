"""One kind of catalogue for everything that a scenario names: models, noise laws, filters and their parts, metrics.

An entry is a frozen dataclass or a function whose keyword parameters *are* the parameters that a scenario may write,
so that the signature is the only place where a parameter is declared:

    @dataclass(frozen=True)
    class Huber:
        '''Huber weight: R is inflated where a whitened residual exceeds the threshold.'''
        threshold: Annotated[float, Gt(0), "Huber threshold beta of (11), in whitened units"] = 1.345

    WEIGHTS = {"huber": Entry("rkfbench.filters.weights:Huber", paper="aladkf-2020", equations="(9)-(11)")}
    build(WEIGHTS, "robust weight", "huber", {"threshold": 2})

An entry may name what it stands for, as above: it is imported when it is first used, so that a command imports the
filters that its scenario has.

Values are checked strictly: a number is never read from a string or a boolean, an unknown parameter is an error.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property, reduce
from importlib import import_module
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Union, get_args, get_origin, get_type_hints

from rkfbench.errors import Path, SpecError, did_you_mean, nearest, under
from rkfbench.interrupts import held

if TYPE_CHECKING:
    from pydantic import BaseModel, ValidationError


@dataclass(frozen=True)
class Limit:
    """A setting in which an entry must equal another one: `Limit({"threshold": 1e9}, "kf")`."""

    params: Mapping[str, Any]
    equals: Any  # a build specification of the other entry
    where: str = ""  # a condition on the model, such as "linear"; "" for every model


@dataclass(frozen=True)
class Entry:
    """What one catalogue name stands for, and what a reader wants to know about it."""

    source: Callable[..., Any] | str  # the class or function itself, or "module:name"
    paper: str = ""  # where it comes from ("aladkf-2020"); "" for what is general
    equations: str = ""  # the equations of that paper: "(9)-(11)"
    needs: frozenset[str] = field(default_factory=frozenset)  # what a reference knows beyond the measurements
    limits: tuple[Limit, ...] = ()

    @cached_property
    def make(self) -> Callable[..., Any]:
        """The class or function whose keyword parameters are those of the entry."""
        if not isinstance(self.source, str):
            return self.source
        module, _, name = self.source.partition(":")
        make: Callable[..., Any] = getattr(import_module(module), name)
        return make

    @property
    def summary(self) -> str:
        """The first paragraph of the docstring of `make`, on one line."""
        return " ".join((inspect.getdoc(self.make) or "").split("\n\n")[0].split())


@dataclass(frozen=True)
class Parameter:
    """One parameter of an entry; `annotation` keeps the bounds and the text that `Annotated` carries."""

    name: str
    annotation: Any
    default: Any  # None when required
    required: bool
    doc: str


@cache
def parameters(make: Callable[..., Any]) -> dict[str, Parameter]:
    """The parameters of an entry by name, in the order of the signature."""
    hints = get_type_hints(make, include_extras=True)
    found = {}
    for name, parameter in inspect.signature(make).parameters.items():
        hint = hints.get(name, Any)
        required = parameter.default is parameter.empty
        doc = next((text for text in getattr(hint, "__metadata__", ()) if isinstance(text, str)), "")
        found[name] = Parameter(name, hint, None if required else parameter.default, required, doc)
    return found


@cache
def parameter_model(make: Callable[..., Any]) -> type[BaseModel]:
    """A pydantic model of the parameters of an entry: strict, no unknown keys, every field with its description."""
    from pydantic import ConfigDict, Field, create_model

    fields: dict[str, Any] = {
        name: (_from_plain(each.annotation), Field(... if each.required else each.default, description=each.doc))
        for name, each in parameters(make).items()
    }
    config = ConfigDict(extra="forbid", strict=True, arbitrary_types_allowed=True, protected_namespaces=())
    with held():
        return create_model(make.__name__, __config__=config, **fields)


class Catalogue(dict[str, Entry]):
    """A catalogue that plug-ins may add to: in the place of one of its names `module:name` may stand, or what an
    installed package announces in the entry point group `rkfbench.<group>`.
    """

    def __init__(self, group: str, entries: Mapping[str, Entry]) -> None:
        super().__init__(entries)
        self.group = group


def lookup(catalogue: Mapping[str, Entry], what: str, name: Any) -> Entry:
    """The entry called `name`; `what` ("filter", "noise law") is used in the message when there is none."""
    if not isinstance(name, str):
        raise SpecError(f"should be the name of a {what}, not {name!r}")
    if name not in catalogue:
        if own := _plugin(catalogue, name):
            return own
        known = did_you_mean(name, catalogue) or f" (known: {', '.join(catalogue)})"
        raise SpecError(f"unknown {what} '{name}'{known}")
    return catalogue[name]


def find(catalogue: Mapping[str, Entry], name: Any) -> Entry | None:
    """The entry called `name`; None where there is none, or one that cannot be used."""
    try:
        return lookup(catalogue, "", name)
    except SpecError:
        return None


def _plugin(catalogue: Mapping[str, Entry], name: str) -> Entry | None:
    if not isinstance(catalogue, Catalogue):
        return None
    from rkfbench.own.entry import entry

    return entry(catalogue.group, name)


def build(catalogue: Mapping[str, Entry], what: str, name: str, params: Mapping[str, Any]) -> Any:
    """Make the entry `name` with the given parameters.

    Raises SpecError for an unknown name, and for all unknown, missing, wrongly typed or out-of-range parameters.
    """
    make = lookup(catalogue, what, name).make
    checked = check(parameter_model(make), params)
    try:
        return make(**{key: getattr(checked, key) for key in checked.model_fields_set})
    except ValueError as error:
        raise SpecError(str(error)) from error


def check(model: type[BaseModel], data: Any) -> Any:
    """`data` as an instance of a pydantic model; SpecError with all faults, each at its path within `data`."""
    from pydantic import ValidationError

    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise _spec_error(error, model, data) from None


def _from_plain(hint: Any) -> Any:
    """The annotation as it reads plain data: a list may stand where a tuple is wanted; all else stays strict."""
    from pydantic import Strict

    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return Annotated[(_from_plain(args[0]), *hint.__metadata__)]
    if origin in (Union, types.UnionType):
        return reduce(or_, map(_from_plain, args))
    if origin is tuple:
        items: Any = tuple.__class_getitem__(tuple(_from_plain(arg) for arg in args))
        return Annotated[items, Strict(False)]
    return hint


def _spec_error(error: ValidationError, model: type[BaseModel], data: Any) -> SpecError:
    found: dict[Path, list[str]] = {}
    misfits: set[Path] = set()
    mistyped: set[Path] = set()
    for each in error.errors(include_url=False):
        if each["type"] == "too_short" and len(each["input"]) >= each["ctx"]["min_length"]:
            continue  # only because its faulty items, which are told, were left out
        path = _within(data, each["loc"])
        if each["type"] == "extra_forbidden":
            message = f"unknown key{did_you_mean(path[-1], siblings := _siblings(model, path))}"
            mistyped.add((*path[:-1], nearest(path[-1], siblings) or ""))
        elif each["type"] == "missing":
            path, message = (*path, each["loc"][-1]), "is required"
        elif each["type"] == "union_tag_not_found":
            path, message = (*path, each["ctx"]["discriminator"].strip("'")), "is required"
        elif each["type"] == "union_tag_invalid":
            key, tag = each["ctx"]["discriminator"].strip("'"), each["ctx"]["tag"]
            known = each["ctx"]["expected_tags"].replace("'", "").split(", ")
            path, message = (*path, key), f"unknown {key} '{tag}'{did_you_mean(tag, known)}"
        else:
            message = re.sub("^(Input |String |Value error, )", "", each["msg"])
        if each["type"].endswith("_type"):
            misfits.add(path)
        if message not in found.setdefault(path, []):
            found[path].append(message)
    # A union complains once for each of its members: those that did not even fit the outer type add nothing.
    # A required key that was mistyped is told once, as the unknown key.
    idle = {path[:end] for path in found for end in range(len(path))} & misfits
    idle |= {path for path in mistyped if found.get(path) == ["is required"]}
    return SpecError.all(
        SpecError(" or ".join([first, *(each.removeprefix("should be ") for each in others)]), path)
        for path, (first, *others) in found.items()
        if path not in idle
    )


def _within(data: Any, loc: Path) -> Path:
    """The part of a pydantic location that exists in the data (unions and wrappers add names of their own)."""
    path: list[str | int] = []
    for key in loc:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            continue
        path.append(key)
    return tuple(path)


def _siblings(model: type[BaseModel], path: Path) -> list[str]:
    """The keys that the model allows beside the last key of `path`."""
    models = [model]
    for key in path[:-1]:
        fields = [each.model_fields[str(key)] for each in models if key in each.model_fields]
        models = [inner for each in fields for inner in _models(each.annotation)] if fields else models
    return [name for each in models for name in each.model_fields]


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The pydantic models that an annotation mentions."""
    if hasattr(annotation, "model_fields"):
        yield annotation
    for inner in get_args(annotation):
        yield from _models(inner)


def build_kind(catalogue: Mapping[str, Entry], what: str, spec: Any) -> Any:
    """Make what `{kind: name, **parameters}` describes; SpecError with the path of each fault."""
    if not isinstance(spec, Mapping) or "kind" not in spec:
        raise SpecError(f"a {what} is written as a mapping with 'kind' (known: {', '.join(catalogue)})")
    with under("kind"):
        lookup(catalogue, what, spec["kind"])
    return build(catalogue, what, spec["kind"], {key: value for key, value in spec.items() if key != "kind"})
