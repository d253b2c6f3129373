"""Reading YAML into plain data that remembers where in the file every value stands.

Scalars follow the core rules of YAML 1.2, whatever PyYAML does by itself: `1e-3` is a number, `no` and `2020-01-01` are
strings, only `true` and `false` are booleans; `inf` is a number too, NaN is refused. Mappings and lists come back as
`Map` and `Seq`, which are a dict and a list with marks. PyYAML is used for its events only, so no object is ever
constructed; the size of what aliases repeat is bounded.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Set
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import yaml

from rkfbench.errors import Problem, ScenarioError, UsageError

MOST_BYTES = 10_000_000
MOST_VALUES = 100_000  # values in a file, those that aliases repeat included
MOST_DEPTH = 40

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_INTEGER = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.?(inf|Inf|INF)")
_NAN = re.compile(r"\.(nan|NaN|NAN)")
_WORDS = dict.fromkeys(("true", "True", "TRUE"), True) | dict.fromkeys(("false", "False", "FALSE"), False)
_NULL = {"", "~", "null", "Null", "NULL"}
_CONFLICT = re.compile(r"^(<<<<<<< .*|=======|>>>>>>> .*)$", re.MULTILINE)


class Mark(NamedTuple):
    """A place: display name of the file, line and column counted from 1 (0: not in a file), and the source line."""

    file: str
    line: int = 0
    column: int = 0
    source: str = ""

    def problem(self, message: str, path: str = "") -> Problem:
        return Problem(self.file, self.line, self.column, path, message, self.source)


class Map(dict[str, Any]):
    """A mapping with the marks of its keys and values; its own mark is where it stands itself."""

    def __init__(self, mark: Mark) -> None:
        super().__init__()
        self.mark = mark
        self.keys_at: dict[str, Mark] = {}  # also of keys that an override has removed
        self.values_at: dict[str, Mark] = {}

    def put(self, key: str, value: Any, key_at: Mark, value_at: Mark) -> None:
        self[key] = value
        self.keys_at[key] = key_at
        self.values_at[key] = value_at

    def only(self, keys: Set[str]) -> Map:
        """A copy with some of the keys."""
        new = self.copy()
        for key in self.keys() - keys:
            del new[key]
        return new

    def copy(self) -> Map:
        """A shallow copy with its own marks."""
        new = Map(self.mark)
        new.update(self)
        new.keys_at.update(self.keys_at)
        new.values_at.update(self.values_at)
        return new


class Seq(list[Any]):
    """A list with the marks of its entries."""

    def __init__(self, mark: Mark) -> None:
        super().__init__()
        self.mark = mark
        self.values_at: list[Mark] = []

    def add(self, value: Any, value_at: Mark) -> None:
        self.append(value)
        self.values_at.append(value_at)

    def copy(self) -> Seq:
        """A shallow copy with its own marks."""
        new = Seq(self.mark)
        new.extend(self)
        new.values_at.extend(self.values_at)
        return new


def read(path: FilePath, display: str) -> Map:
    """The mapping that a YAML file holds; ScenarioError where it is not one."""
    try:
        with path.open("rb") as file:
            raw = file.read(MOST_BYTES + 1)
    except IsADirectoryError:
        raise UsageError(f"{display}: is a directory, not a file") from None
    except OSError as error:
        raise UsageError(f"{display}: {(error.strerror or str(error)).lower()}") from None
    if len(raw) > MOST_BYTES:
        raise UsageError(f"{display}: larger than {MOST_BYTES // 10**6} MB")
    if b"\0" in raw:
        raise UsageError(f"{display}: not a text file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw[: error.start].count(b"\n") + 1
        raise UsageError(f"{display}:{line}: not UTF-8 text") from None
    return parse(text, display)


def parse(text: str, display: str) -> Map:
    """The mapping that a YAML text holds."""
    lines = text.splitlines()
    if conflict := _CONFLICT.search(text):
        line = text.count("\n", 0, conflict.start()) + 1
        raise ScenarioError([Mark(display, line, 1, conflict[0]).problem("unresolved merge conflict")])
    start = Mark(display, 1, 1, lines[0] if lines else "")
    root: Any = _Reader(display, lines).document(text)
    if root is None:
        raise ScenarioError([Mark(display).problem("the file is empty")])
    if not isinstance(root, Map):
        raise ScenarioError([start.problem("should be a mapping with keys such as 'name' and 'model'")])
    return root


def parse_value(text: str, mark: Mark) -> Any:
    """One value as a command line gives it (`0.1`, `[1, 2]`, `{kind: gaussian, cov: 1}`), all of it at `mark`."""
    return _Reader(mark.file, [], mark).document(text)


def scalar(text: str) -> Any:
    """The value of a plain scalar by the YAML 1.2 core rules; ValueError for NaN."""
    if text in _NULL:
        return None
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text) and len(text) < 20:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _INFINITE.fullmatch(text):
        return float(text.replace(".", ""))
    if _NAN.fullmatch(text):
        raise ValueError("NaN is not a value")
    return text


class _Dumper(yaml.SafeDumper):
    """Writes what this module reads back as the same: a string that looks like another scalar is quoted."""

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_text(self, data: str) -> yaml.ScalarNode:
        try:
            quoted = not isinstance(scalar(data), str)
        except ValueError:
            quoted = True
        return self.represent_scalar("tag:yaml.org,2002:str", data, style="'" if quoted else None)


_Dumper.add_representer(str, _Dumper.represent_text)


def dump(data: Any) -> str:
    """Plain data as YAML, short lists and mappings on one line."""
    text: str = yaml.dump(data, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)
    return text


def plain(value: Any) -> Any:
    """The same data as ordinary dicts and lists."""
    if isinstance(value, dict):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [plain(each) for each in value]
    return value


def marked(value: Any, mark: Mark) -> Any:
    """Plain data as `Map` and `Seq` with everything at one mark; what has marks keeps them."""
    if isinstance(value, (Map, Seq)):
        return value
    if isinstance(value, dict):
        new = Map(mark)
        for key, each in value.items():
            new.put(key, marked(each, mark), mark, mark)
        return new
    if isinstance(value, list):
        seq = Seq(mark)
        for each in value:
            seq.add(marked(each, mark), mark)
        return seq
    return value


class _Reader:
    """Builds data from the events of one YAML text. With `fixed`, everything stands at that mark."""

    def __init__(self, display: str, lines: list[str], fixed: Mark | None = None) -> None:
        self.display = display
        self.lines = lines
        self.fixed = fixed
        self.anchors: dict[str, tuple[Any, int]] = {}  # value and number of values in it
        self.values = 0
        self.events: Iterator[Any] = iter(())

    def document(self, text: str) -> Any:
        try:
            self.events = yaml.parse(text, Loader=_LOADER)
            return self._document()
        except yaml.MarkedYAMLError as error:
            mark = self.at(error.problem_mark)
            message = f"{error.problem or 'not YAML'} {error.context or ''}".strip()
            if mark.source[mark.column - 1 : mark.column] == "\t":
                message = "tabs cannot indent YAML: use spaces"
            raise ScenarioError([mark.problem(message)]) from None
        except (yaml.YAMLError, UnicodeError):
            self.fail(None, "contains characters that YAML does not allow")

    def _document(self) -> Any:
        root: Any = None
        documents = 0
        for event in self.events:
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self.fail(event.start_mark, "should hold one document, not several")
            elif isinstance(event, yaml.NodeEvent):
                root, _ = self.node(event, 0)
        return root

    def node(self, event: Any, depth: int) -> tuple[Any, int]:
        """The data of the node that begins with `event`, and the number of values in it."""
        value: Any
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in self.anchors:
                self.fail(event.start_mark, f"alias '*{event.anchor}' stands for nothing before it")
            value, size = self.anchors[str(event.anchor)]
            self.count(event, size)
            return value, size
        if event.tag is not None:
            self.fail(event.start_mark, f"tags such as '{event.tag}' are not used here")
        if depth > MOST_DEPTH:
            self.fail(event.start_mark, f"nested more than {MOST_DEPTH} levels deep")
        self.count(event, 1)
        if isinstance(event, yaml.ScalarEvent):
            value, size = self.scalar(event), 1
        elif isinstance(event, yaml.SequenceStartEvent):
            value, size = self.sequence(event, depth)
        else:
            value, size = self.mapping(event, depth)
        if event.anchor:
            self.anchors[str(event.anchor)] = value, size
        return value, size

    def scalar(self, event: Any) -> Any:
        if not event.implicit[0]:  # quoted or block text
            return event.value
        try:
            return scalar(event.value)
        except ValueError as error:
            self.fail(event.start_mark, str(error))

    def sequence(self, event: Any, depth: int) -> tuple[Seq, int]:
        seq, size = Seq(self.mark(event)), 1
        while not isinstance(inner := next(self.events), yaml.SequenceEndEvent):
            value, inner_size = self.node(inner, depth + 1)
            seq.add(value, self.mark(inner))
            size += inner_size
        return seq, size

    def mapping(self, event: Any, depth: int) -> tuple[Map, int]:
        new, size = Map(self.mark(event)), 1
        while not isinstance(key := next(self.events), yaml.MappingEndEvent):
            if not isinstance(key, yaml.ScalarEvent) or key.tag is not None or key.anchor:
                self.fail(key.start_mark, "a key should be a plain name")
            if key.value == "<<":
                self.fail(key.start_mark, "merge keys are not used here: write an override of a reading or case")
            if key.value in new:
                self.fail(key.start_mark, f"duplicate key '{key.value}' (first in line {new.keys_at[key.value].line})")
            inner = next(self.events)
            value, inner_size = self.node(inner, depth + 1)
            block = isinstance(value, (Map, Seq)) and not getattr(inner, "flow_style", True)
            new.put(key.value, value, self.mark(key), self.mark(key if block else inner))
            size += inner_size
        return new, size

    def count(self, event: Any, size: int) -> None:
        self.values += size
        if self.values > MOST_VALUES:
            self.fail(event.start_mark, f"holds more than {MOST_VALUES} values")

    def mark(self, event: Any) -> Mark:
        return self.fixed or self.at(event.start_mark)

    def at(self, mark: Any) -> Mark:
        if self.fixed or mark is None:
            return self.fixed or Mark(self.display)
        source = self.lines[mark.line] if mark.line < len(self.lines) else ""
        return Mark(self.display, mark.line + 1, mark.column + 1, source)

    def fail(self, mark: Any, message: str) -> Any:
        raise ScenarioError([self.at(mark).problem(message)])
