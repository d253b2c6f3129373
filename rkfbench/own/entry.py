"""From the object that a plug-in names to a catalogue entry: the parameters are those of its signature.

A parameter without an annotation is checked by its default: a number, a word, or true and false.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Mapping
from typing import Any, get_type_hints

from rkfbench.catalogue import Entry
from rkfbench.errors import SpecError
from rkfbench.own import names

Params = Mapping[str, Any]
Adapt = Callable[[Params], Any]  # from checked parameters to what the catalogue's own entries make

_entries: dict[tuple[str, str], Entry] = {}


def entry(group: str, name: Any) -> Entry | None:
    """The entry of the plug-in `name` in the catalogue of a group (filters, models, noises, metrics, weights).

    None when the name means no plug-in; SpecError when it means one that cannot be used.
    """
    if not isinstance(name, str):
        return None
    if (group, name) not in _entries:
        names.refuse_unnamed(name)
        target = names.find(name) if names.is_reference(name) else names.find_installed(group, name)
        if target is None:
            return None
        _entries[group, name] = _entry(group, name, target)
    return _entries[group, name]


def forget() -> None:
    """Make all entries anew when they are asked for again."""
    _entries.clear()


def _entry(group: str, name: str, target: Any) -> Entry:
    from rkfbench.own import filters, parts

    adapters: dict[str, Callable[[str, Any, Collection[str]], tuple[Adapt, tuple[str, ...]]]] = {
        "filters": filters.adapted,
        "models": parts.model,
        "noises": parts.noise,
        "metrics": parts.metric,
        "weights": parts.weight,
    }
    if not callable(target):
        raise SpecError(f"{name} is not callable: name a function or a class, whose parameters the scenario gives")
    signature, hints = _signature(name, target)
    adapt, given = adapters[group](name, target, signature)
    own = {key: each for key, each in signature.items() if key not in given}

    def make(**params: Any) -> Any:
        try:
            return adapt(params)
        except ValueError:  # the catalogue makes a fault of the description of it
            raise
        except SpecError:
            raise
        except (Exception, SystemExit) as error:
            raise SpecError(f"{name} raised {type(error).__name__}: {error}") from error

    make.__name__ = names.short(name)
    make.__doc__ = inspect.getdoc(target)
    make.__annotations__ = {key: hints.get(key, _hint(each)) for key, each in own.items()}
    make.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [each.replace(kind=inspect.Parameter.KEYWORD_ONLY) for each in own.values()]
    )
    declared = {key: getattr(target, key, ()) for key in ("needs", "limits") if key not in signature}
    return Entry(make, needs=frozenset(declared.get("needs", ())), limits=tuple(declared.get("limits", ())))


def _signature(name: str, target: Any) -> tuple[dict[str, inspect.Parameter], dict[str, Any]]:
    """The parameters of a callable by name, without *args and **kwargs, and what its annotations mean."""
    declared = target.__init__ if inspect.isclass(target) else target
    try:
        signature = inspect.signature(target)
        hints = get_type_hints(declared, include_extras=True) if hasattr(declared, "__annotations__") else {}
    except Exception as error:
        raise SpecError(f"the signature of {name} cannot be read: {type(error).__name__}: {error}") from error
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return {key: each for key, each in signature.parameters.items() if each.kind not in variadic}, hints


def _hint(parameter: inspect.Parameter) -> Any:
    """The type that the default of a parameter without annotation stands for; a whole number may be any number."""
    kind = type(parameter.default)
    return {bool: bool, int: float, float: float, str: str}.get(kind, Any)
