"""Which file or module the name of a plug-in means, and what it holds.

Files are looked for in one folder at a time, that of the scenario in hand; `beside` says which. Nothing is imported but
what is named, and what that imports.
"""

from __future__ import annotations

import ast
import importlib
import os
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.machinery import PathFinder, SourceFileLoader
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

from rkfbench.errors import InputChanged, SpecError, did_you_mean
from rkfbench.own import sources
from rkfbench.own.sources import Source

PEERS = "rkfbench.adapters."  # modules that need the extra `peers`
OWN = "rkfbench/own/"
GROUPS = ("filters", "models", "noises", "metrics", "weights")


@dataclass(frozen=True)
class Loaded:
    """A plug-in's module, what it is made of, and the hash of that, as they were when it was imported.

    `folder` is that of the scenario, for a file there; None for a module that Python has found.
    """

    module: ModuleType
    folder: Path | None
    sources: Mapping[str, Source]
    digest: str

    @classmethod
    def of(cls, module: ModuleType, folder: Path | None) -> Loaded:
        inside = sources.closure(Path(str(module.__file__)), module.__name__, folder)
        return cls(module, folder, inside, sources.digest(inside, folder))

    @property
    def stale(self) -> bool:
        """Whether what it is made of has changed on the disk."""
        try:
            return Loaded.of(self.module, self.folder).digest != self.digest
        except (OSError, SpecError):  # something is not there any more
            return True


# Ends an entry of sys.path that was made here, and changes nothing else: worker processes inherit such entries, and
# what stood there before stays.
OURS = 2 * os.sep

_folder: list[Path] = []  # at most one
_loaded: dict[str, Loaded] = {}  # by the part of the name before the colon
_homes: dict[str, str] = {}  # of every plug-in name that was found: that part


def is_reference(name: Any) -> bool:
    """Whether a name means a plug-in, not an entry of a catalogue: `module:name` or `path/file.py:name`."""
    home, colon, attribute = name.rpartition(":") if isinstance(name, str) else ("", "", "")
    return bool(home.strip() and colon and attribute.isidentifier())


def short(name: Any) -> Any:
    """How a plug-in is called where its place does not matter: `my_filter` for `path/my.py:my_filter`."""
    return name.rpartition(":")[2] if is_reference(name) else name


def beside(folder: Path) -> None:
    """Look for the files of plug-ins in `folder` from now on; those that have changed on the disk are imported anew."""
    folder = folder.resolve()
    if [folder] != _folder:
        stale = [home for home, old in _loaded.items() if old.folder is not None]
        sys.path[:] = [place for place in sys.path if not place.endswith(OURS)]
        _folder[:] = [folder]
    else:
        stale = [home for home, old in _loaded.items() if old.folder is not None and old.stale]
    for home in stale:
        _forget(home)


def find(name: str) -> Any:
    """The object that `module:name` or `file.py:name` names; SpecError if there is none."""
    home, _, attribute = name.rpartition(":")
    if home not in _loaded:
        _loaded[home] = _imported(home)
    _homes[name] = home
    module = _loaded[home].module
    if not hasattr(module, attribute):
        public = [key for key, each in vars(module).items() if key[:1] != "_" and not isinstance(each, ModuleType)]
        raise SpecError(f"{home} has no '{attribute}'{did_you_mean(attribute, public)}")
    return getattr(module, attribute)


def refuse_unnamed(name: str) -> None:
    """SpecError for a file of which no function or class is named; it is read, not imported, to tell which it has."""
    home, _, _ = name.partition(":")
    if is_reference(name) or not home.endswith(".py"):
        return
    file = _file(home)
    assert file is not None
    try:
        body = ast.parse(file.read_bytes()).body
    except (OSError, SyntaxError, ValueError):
        body = []  # whoever imports it will tell
    named = [each.name for each in body if isinstance(each, ast.FunctionDef | ast.ClassDef) and each.name[:1] != "_"]
    has = f" (it has {', '.join(named)})" if named else ""
    raise SpecError(f"which function or class of {home}? Write {home}:{named[0] if len(named) == 1 else 'NAME'}{has}")


def find_installed(group: str, name: str) -> Any:
    """The object that an installed package has announced under `name` in an entry point group; None if there is none.

    SpecError if it cannot be imported.
    """
    point = entry_points(group).get(name)
    if point is None:
        return None
    made = find(point)
    _homes[name] = _homes[point]
    return made


@cache
def entry_points(group: str) -> dict[str, str]:
    """The plug-ins that installed packages announce in `rkfbench.<group>`: name and `module:name`."""
    from importlib import metadata

    return {each.name: each.value.replace(" ", "") for each in metadata.entry_points(group=f"rkfbench.{group}")}


def hides(name: str) -> bool:
    """Whether a file of that name in the current folder would hide a module that is installed."""
    mine = {_current(), Path.cwd().resolve()}
    elsewhere = [each for each in sys.path if Path(each).resolve() not in mine]
    return name in sys.builtin_module_names or PathFinder.find_spec(name, elsewhere) is not None


def pins(data: Any) -> dict[str, str]:
    """The plug-ins that a description names, each with the hash of its sources."""
    found = {text for text in texts(data) if _homes.get(text) in _loaded} if _loaded else ()
    return {name: _loaded[_homes[name]].digest for name in sorted(found)}


def ready(folder: str, sources: Mapping[str, str]) -> None:
    """Import plug-ins as another process did; InputChanged if they are not the same any more."""
    beside(Path(folder))
    for name, digest in sources.items():
        try:
            for group in GROUPS if not is_reference(name) else ():
                find_installed(group, name)
            if is_reference(name):
                find(name)
        except SpecError:
            raise InputChanged(f"the source of {name}") from None
        loaded = _loaded.get(_homes.get(name, ""))  # None: no package here announces it
        if loaded is None or loaded.digest != digest:
            raise InputChanged(f"the source of {name}")


def copies(data: Any) -> dict[str, bytes]:
    """The files beside the scenario that the plug-ins of a description are made of, by their path in its folder, as
    they were when they were imported.
    """
    found: dict[str, bytes] = {}
    for name in pins(data):
        loaded = _loaded[_homes[name]]
        for path, content in loaded.sources.values():
            if loaded.folder is not None and path.is_relative_to(loaded.folder):
                found[path.relative_to(loaded.folder).as_posix()] = content
    return found


def files() -> dict[str, str]:
    """The files of all plug-ins in use, with the name by which each was asked for."""
    return {str(_loaded[home].module.__file__): name for name, home in _homes.items() if home in _loaded}


def texts(data: Any) -> Iterator[str]:
    """All strings of a description but labels; of a metric, its name."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield str(key)
            if key != "label":
                yield from texts(value)
    elif isinstance(data, list | tuple):
        for value in data:
            yield from texts(value)
    elif isinstance(data, str):
        yield data
        for end in "([@":
            yield data.partition(end)[0]


def _file(home: str) -> Path | None:
    """The file beside the scenario that `home` means; None for a module that Python is to find."""
    is_file = home.endswith(".py")
    if not is_file and not home.isidentifier():
        return None
    folder = _current()
    relative = Path(home if is_file else f"{home}.py")
    if relative.is_absolute() or ".." in relative.parts:
        raise SpecError(f"{home} is not inside the folder of the scenario: `plugins: FOLDER` names another folder")
    if os.path.isfile(folder / relative):
        return folder / relative
    if is_file:
        raise SpecError(f"there is no file {home} in {folder}")
    return None


def _imported(home: str) -> Loaded:
    file = _file(home)
    try:
        module = importlib.import_module(home) if file is None else _executed(file)
    except (Exception, SystemExit) as error:
        where = "" if isinstance(error, SyntaxError) else _place(error)
        extra = " (pip install 'rkfbench[peers]')" if home.startswith(PEERS) else ""
        raise SpecError(f"cannot be imported: {type(error).__name__}: {error}{where}{extra}") from error
    if getattr(module, "__file__", None) is None:
        raise SpecError(f"{home} is not a module with a file of its own")
    loaded = Loaded.of(module, None if file is None else _current())
    if file is not None:
        for name, (path, _) in loaded.sources.items():
            taken = getattr(sys.modules.get(name), "__file__", None)
            if path != file and taken is not None and not path.samefile(taken):
                raise SpecError(f"it imports '{name}', which is {taken}: give {path.name} another name")
    return loaded


def _current() -> Path:
    """The folder in which files are looked for."""
    return _folder[0] if _folder else Path.cwd().resolve()


def _executed(file: Path) -> ModuleType:
    """The module that a file makes. It may import what lies in the scenario's folder, after all that is installed."""
    import importlib.util

    if not {str(_current()), f"{_current()}{OURS}"} & {*sys.path}:
        sys.path.append(f"{_current()}{OURS}")
    importlib.invalidate_caches()
    name = f"{file.stem}@rkfbench"  # no import statement can mean it
    loader = FromSource(name, str(file))
    spec = importlib.util.spec_from_loader(name, loader)
    assert spec is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # nor of its neighbours, see FromSource
    try:
        loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    finally:
        sys.dont_write_bytecode = writes
    return module


class FromSource(SourceFileLoader):
    """Compiles the file as it is now: compiled code that is kept beside it may be that of the last edit."""

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


def _place(error: BaseException) -> str:
    """` (my.py, line 3)`: the innermost line of the traceback that is not ours."""
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [each for each in frames if "importlib" not in each.filename and OWN not in each.filename]
    return f" ({Path(theirs[-1].filename).name}, line {theirs[-1].lineno})" if theirs else ""


def _forget(home: str) -> None:
    """Let a module be imported anew the next time it is named, with all that was made of it."""
    from rkfbench import metrics
    from rkfbench.own import entry

    old = _loaded.pop(home)
    sys.modules.pop(old.module.__name__, None)
    for name, (path, _) in old.sources.items():
        if getattr(sys.modules.get(name), "__file__", None) == str(path):
            del sys.modules[name]
    entry.forget()
    metrics.get.cache_clear()
