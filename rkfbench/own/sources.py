"""The hash of a plug-in's sources: its own file, the modules beside it that it imports, and the versions of the
packages that they import. Numbers that a plug-in made are used again only while this hash stays the same.

Imports are read from the sources, not from what happens to be loaded, so the hash is the same in every process.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

COVERED = "rkfbench"  # our own code has a hash of its own
NOT_COVERED = "rkfbench.adapters"


def closure(file: Path, module: str, folder: Path | None) -> dict[str, Path]:
    """The file of the module `module`, and those of the modules that it and they import, by name.

    Of a file, what lies in `folder`; without a folder, what belongs to the same top-level package.
    """
    module = module.partition("@")[0]
    root = folder or file.parents[module.count(".") + (file.name == "__init__.py")]
    found = {module: file}
    waiting = [(module, file)]
    while waiting:
        current, path = waiting.pop()
        for name in imports(path, current):
            if folder is None and (_top(name) != _top(module) or _covered(name)):
                continue
            for each, source in _files(root, name):
                if each not in found and source != file:
                    found[each] = source
                    waiting.append((each, source))
    return found


def digest(inside: Mapping[str, Path], installed: bool) -> str:
    """The hash of the sources `inside` and of the versions of all that they import from outside."""
    total = hashlib.sha256()
    for name, path in sorted(inside.items()):
        total.update(f"\n{name}\n".encode())
        total.update(path.read_bytes())
    packages = {_top(name) for each, path in inside.items() for name in imports(path, each)}
    own = {_top(name) for name in inside}
    packages = (packages | own if installed else packages - own) - {"", COVERED, *sys.stdlib_module_names}
    for package in sorted(packages):
        total.update(f"\n{package} {_version(package)}".encode())
    return total.hexdigest()[:16]


def imports(path: Path, module: str) -> Iterator[str]:
    """The dotted names that the import statements of a file may mean."""
    import ast

    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):  # not Python, or told where it is imported
        return
    package = (module if path.name == "__init__.py" else module.rpartition(".")[0]).split(".")
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield base
            yield from (f"{base}.{each.name}" for each in node.names)


def _top(name: str) -> str:
    return name.partition(".")[0]


def _covered(name: str) -> bool:
    return _top(name) == COVERED and not f"{name}.".startswith(f"{NOT_COVERED}.")


def _files(root: Path, name: str) -> Iterator[tuple[str, Path]]:
    """The files of a dotted name below `root`: of each package on the way, and of the module itself."""
    parts = name.split(".")
    for end in range(1, len(parts) + 1 if all(parts) else 1):
        for path in (
            root.joinpath(*parts[: end - 1], f"{parts[end - 1]}.py"),
            root.joinpath(*parts[:end], "__init__.py"),
        ):
            if path.is_file():
                yield ".".join(parts[:end]), path


@cache
def _version(package: str) -> str:
    """The version of the installed distribution that has a top-level package; "" when there is none."""
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        distributions = metadata.packages_distributions().get(package, [])
        return " ".join(metadata.version(each) for each in sorted(set(distributions)))
