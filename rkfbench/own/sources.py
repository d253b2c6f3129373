"""What a plug-in is made of, and the hash of it: numbers that a plug-in made are used again only while it stays the
same. It is made of

    its own file, and the modules beside it that it imports
    modules from elsewhere that no version stands for: on PYTHONPATH, or of a package that is installed as editable
    the files beside any of these that it reads, which the module names: READS = ["weights.csv"]
    the versions of all other packages that they import

Imports are read from the sources, not from what happens to be loaded, so the hash is the same in every process.
"""

from __future__ import annotations

import ast
import hashlib
import sys
from collections.abc import Iterator, Mapping
from functools import cache, lru_cache
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from rkfbench.errors import SpecError

COVERED = "rkfbench"  # our own code has a hash of its own
NOT_COVERED = "rkfbench.adapters"
READS = "READS"  # where a module names the files beside it that it reads


class Source(NamedTuple):
    """A file, as it was read."""

    path: Path
    content: bytes


class Said(NamedTuple):
    """What a module says of itself: the dotted names that its import statements may mean, the files that it names (None
    where it names none), and whether it asks where it stands.
    """

    imports: tuple[str, ...] = ()
    reads: tuple[str, ...] | None = None
    asks_where: bool = False


def closure(file: Path, module: str, folder: Path | None) -> dict[str, Source]:
    """The module `module` that `file` holds, and all that it is made of: modules by their dotted name, files that they
    read as `module:name`.

    `folder` is that of the scenario, for a file there; None for a module that Python has found. SpecError where a
    module in that folder asks where it stands and does not say which files it reads there.
    """
    module = module.partition("@")[0]
    root = folder or file.parents[module.count(".") + (file.name == "__init__.py")]
    found = {module: Source(file, file.read_bytes())}
    waiting = [module]
    while waiting:
        current = waiting.pop()
        path, content = found[current]
        said = _said(content, _package(path, current))
        if folder is not None and said.asks_where and said.reads is None and path.is_relative_to(folder):
            raise SpecError(
                f"{path.name} asks for __file__ and does not say what it reads there: write {READS} = ['name', ...] "
                f"with the files beside it, which are hashed and copied with it, or {READS} = []"
            )
        found |= {f"{current}:{name}": _named(path, name) for name in said.reads or ()}
        for name in said.imports:
            for each, source in _modules(name, module, folder, root):
                if each not in found and source != file:
                    found[each] = Source(source, source.read_bytes())
                    waiting.append(each)
    return found


def digest(inside: Mapping[str, Source], folder: Path | None) -> str:
    """The hash of what a plug-in is made of, and of the versions of all packages that it imports."""
    total = hashlib.sha256()
    for name, source in sorted(inside.items()):
        total.update(f"\n{name}\n".encode())
        total.update(source.content)
    modules = {name: source for name, source in inside.items() if ":" not in name}
    packages = {_top(name) for each, (path, content) in modules.items() for name in _imports(content, path, each)}
    here = {_top(name) for name, source in modules.items() if folder is not None and source.path.is_relative_to(folder)}
    own = set() if folder is not None else {_top(name) for name in modules}
    for package in sorted((packages | own) - here - {"", COVERED, *sys.stdlib_module_names}):
        total.update(f"\n{package} {_version(package)}".encode())
    return total.hexdigest()[:16]


def _imports(content: bytes, path: Path, module: str) -> tuple[str, ...]:
    return _said(content, _package(path, module)).imports


def _package(path: Path, module: str) -> str:
    """The package from which a module's relative imports are seen."""
    return module if path.name == "__init__.py" else module.rpartition(".")[0]


@lru_cache(maxsize=1024)
def _said(content: bytes, package: str) -> Said:
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError):  # not Python, or told where it is imported
        return Said()
    names = list(_imported(tree, package.split(".")))
    asks = any(isinstance(node, ast.Name) and node.id == "__file__" for node in ast.walk(tree))
    return Said(tuple(names), _reads(tree), asks)


def _imported(tree: ast.Module, package: list[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{each.name}" for each in node.names)


def _reads(tree: ast.Module) -> tuple[str, ...] | None:
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(isinstance(each, ast.Name) and each.id == READS for each in targets):
                return _names(node.value)
    return None


def _names(value: ast.expr) -> tuple[str, ...]:
    try:
        names = ast.literal_eval(value)
    except (ValueError, TypeError, SyntaxError):
        names = None
    if not isinstance(names, list | tuple) or not all(isinstance(each, str) for each in names):
        raise SpecError(f"{READS} should be a list of names, written out: {READS} = ['weights.csv']")
    return tuple(names)


def _named(path: Path, name: str) -> Source:
    """The file `name` beside the module at `path`."""
    relative = Path(name)
    if relative.is_absolute() or ".." in relative.parts:
        raise SpecError(f"{READS} of {path.name} names {name}, which is not in the folder of {path.name}")
    try:
        return Source(path.parent / relative, (path.parent / relative).read_bytes())
    except OSError:
        raise SpecError(f"{READS} of {path.name} names {name}, and there is no such file beside it") from None


def _modules(name: str, module: str, folder: Path | None, root: Path) -> Iterator[tuple[str, Path]]:
    """The files of what the dotted `name` means to the plug-in `module`, as far as they are to be hashed."""
    of_ours = _top(name) == _top(module) and not _covered(name) if folder is None else any(_files(root, name))
    for place in [root] if of_ours else _unversioned(_top(name)):
        yield from _files(place, name)


def _unversioned(package: str) -> list[Path]:
    """The folders that hold a top-level package for which no version stands; none for one that is installed."""
    if package in ("", COVERED, "__main__") or package in sys.stdlib_module_names:
        return []
    try:
        spec = find_spec(package)
    except (ImportError, ValueError, AttributeError):
        return []
    if spec is None:
        return []
    if spec.submodule_search_locations is not None:
        places = [Path(each).parent for each in spec.submodule_search_locations]
    else:
        places = [Path(spec.origin).parent] if spec.has_location and spec.origin else []
    return [place for place in places if not any(place.resolve().is_relative_to(home) for home in _homes(package))]


def _top(name: str) -> str:
    return name.partition(".")[0]


def _covered(name: str) -> bool:
    return _top(name) == COVERED and not f"{name}.".startswith(f"{NOT_COVERED}.")


def _files(root: Path, name: str) -> Iterator[tuple[str, Path]]:
    """The files of a dotted name below `root`: of each package on the way, and of the module itself."""
    parts = name.split(".")
    for end in range(1, len(parts) + 1 if all(parts) else 1):
        inner = root.joinpath(*parts[: end - 1])
        of_module = (inner / f"{parts[end - 1]}{suffix}" for suffix in (".py", *EXTENSION_SUFFIXES))
        for path in (*of_module, inner / parts[end - 1] / "__init__.py"):
            if path.is_file():
                yield ".".join(parts[:end]), path


@cache
def _version(package: str) -> str:
    """The version of the installed distribution that has a top-level package; "" when there is none."""
    from importlib import metadata

    return " ".join(metadata.version(each) for each in _distributions(package))


@cache
def _homes(package: str) -> list[Path]:
    """The folders into which the distributions that have a top-level package are installed."""
    from importlib import metadata

    return [Path(str(metadata.distribution(each).locate_file(""))).resolve() for each in _distributions(package)]


@cache
def _distributions(package: str) -> list[str]:
    from importlib import metadata

    try:
        metadata.version(package)
        return [package]
    except metadata.PackageNotFoundError:
        return sorted(set(_all_distributions().get(package, [])))


@cache
def _all_distributions() -> Mapping[str, list[str]]:
    from importlib import metadata

    return metadata.packages_distributions()
