"""The errors that rkfbench raises on purpose, each with the exit code of the command that meets it.

A `SpecError` says that a description (plain data: numbers, names, lists, mappings) makes no sense, and where inside
that description. Whoever knows which file the description came from turns it into `Problem`s, which have a line and a
column, and raises them all at once as a `ScenarioError`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from difflib import get_close_matches

Key = str | int
Path = tuple[Key, ...]


class RkfbenchError(Exception):
    """Anything that ends a command with one clear message and no traceback."""

    exit_code = 1


class UsageError(RkfbenchError):
    """A wrong option, a missing file, unreadable results."""

    exit_code = 2


class InputChanged(UsageError):
    """What a study reads, a file or a plug-in, is not what it was when the study began; made with its name."""

    def __str__(self) -> str:
        return (
            f"{self.args[0]} was changed while the study ran: run the same command again "
            "(finished blocks are kept; what the change concerns is computed anew)"
        )


class Different(RkfbenchError):
    """A verdict or a compared number differs from the stored one."""

    exit_code = 3


class SpecError(UsageError):
    """A description that makes no sense; `path` are the keys and indices from the described thing to the fault.

    One error may carry `more` of them, so that all faults of a description are told at once.
    """

    def __init__(self, message: str, path: Sequence[Key] = (), more: Iterable[SpecError] = ()) -> None:
        self.message = message
        self.path: Path = tuple(path)
        self.more: tuple[SpecError, ...] = tuple(more)
        super().__init__(message, self.path, self.more)

    def __str__(self) -> str:
        place = f"{dotted(self.path)}: " if self.path else ""
        return "\n".join([place + self.message, *map(str, self.more)])

    def __iter__(self) -> Iterator[SpecError]:
        """This fault and the others that came with it, each as an error of its own."""
        yield SpecError(self.message, self.path)
        for each in self.more:
            yield from each

    def under(self, *prefix: Key) -> SpecError:
        """The same error seen from a description that holds this one under the keys `prefix`."""
        return SpecError(self.message, (*prefix, *self.path), [each.under(*prefix) for each in self.more])

    @classmethod
    def all(cls, errors: Iterable[SpecError]) -> SpecError:
        """One error that carries all of `errors` (at least one)."""
        first, *more = (single for error in errors for single in error)
        return cls(first.message, first.path, more)


@contextmanager
def under(*prefix: Key) -> Iterator[None]:
    """A SpecError raised inside is about the part of the description at `prefix`."""
    try:
        yield
    except SpecError as error:
        raise error.under(*prefix) from None


@contextmanager
def collect(faults: list[SpecError]) -> Iterator[None]:
    """A SpecError raised inside is put to the others."""
    try:
        yield
    except SpecError as error:
        faults.append(error)


@dataclass(frozen=True)
class Problem:
    """One fault of a file: where it stands (line and column count from 1; 0 means not in a file) and what is wrong."""

    file: str
    line: int
    column: int
    path: str
    message: str
    source: str = ""

    def render(self) -> str:
        """`file:line:column: path: message`, the source line and a caret below the column."""
        place = f"{self.file}:{self.line}:{self.column}" if self.line else printable(self.file)
        text = ": ".join(part for part in (place, printable(self.path), self.message) if part)
        if not self.source:
            return text
        start = max(0, self.column - 120)
        return f"{text}\n  {self.source[start : start + 160]}\n  {' ' * (self.column - 1 - start)}^"


class ScenarioError(UsageError):
    """All problems of a scenario or paper file at once; its text is what the user reads."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__(self.problems)

    def __str__(self) -> str:
        return "\n".join(problem.render() for problem in self.problems)


def dotted(path: Iterable[Key]) -> str:
    """A path as the user writes it: `filters.hkf.threshold`."""
    return printable(".".join(str(key) for key in path))


def printable(text: str) -> str:
    """The text with escapes for what would garble a line of a terminal."""
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode() for each in text)


def nearest(name: object, known: Iterable[object]) -> str | None:
    """The known name that `name` may have been meant to be."""
    return next(iter(get_close_matches(str(name), [str(each) for each in known], n=1)), None)


def did_you_mean(name: object, known: Iterable[object]) -> str:
    """` (did you mean 'rate'?)` for the known name nearest to `name`, else an empty string."""
    near = nearest(name, known)
    return f" (did you mean '{near}'?)" if near else ""
