"""What the user sees: data on stdout, everything else on stderr, progress while a study runs.

On a terminal the progress is a bar with rate and time left (rich); elsewhere it is one plain line for each finished
case. `--json` turns data into JSON, `-q` silences all but data and errors, `-v` shows tracebacks.
"""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TextIO

from rkfbench.errors import RkfbenchError

if TYPE_CHECKING:
    from rkfbench.study.events import Event, Failure

MOST_NAMED = 3  # cases that one line names
MOST_FAILURES = 3  # of one filter that are told


@contextmanager
def written() -> Iterator[None]:
    """A standard output that takes no more as one message; of a reader that went away others tell."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        raise RkfbenchError(f"cannot write to the standard output: {error.strerror}") from error


@dataclass
class Terminal:
    """The two streams, with the manner of speaking that the options ask for."""

    json: bool = False
    quiet: bool = False
    verbose: bool = False
    color: bool = True
    activity: str = ""  # what an interruption would leave behind
    out: TextIO = field(default_factory=lambda: sys.stdout)  # as it was, whatever `print` means meanwhile

    def data(self, text: str) -> None:
        """What was asked for."""
        with written():
            self.out.write(text if text.endswith("\n") else text + "\n")

    def note(self, text: str) -> None:
        """What happens on the way."""
        if not self.quiet:
            print(text, file=sys.stderr)

    def error(self, text: str) -> None:
        """What went wrong."""
        print(text, file=sys.stderr)

    def records(self, records: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> None:
        """A table, as aligned columns or as JSON."""
        if self.json:
            self.object(list(records))
            return
        rows = [list(columns), *([_cell(record.get(column)) for column in columns] for record in records)]
        widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
        for row in rows:
            self.data("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())

    def object(self, content: Any) -> None:
        """Plain data as JSON, which has no infinity and no NaN: null stands for them."""
        self.data(json.dumps(_finite(content), indent=2, ensure_ascii=False, default=str, allow_nan=False))

    @contextmanager
    def progress(self, name: str) -> Iterator[Callable[[Event], None]]:
        """A listener to the events of the study called `name`."""
        told: Counter[str] = Counter()
        with self._bar(name) as advance:

            def listen(event: Event) -> None:
                from rkfbench.study import events

                match event:
                    case events.Recomputing(cases, reason):
                        which = ", ".join(cases) if len(cases) <= MOST_NAMED else f"{len(cases)} cases"
                        self.note(f"{name}: recomputing {which}: {reason}")
                    case events.Spoiled(files):
                        what = ", ".join(files)
                        self.note(f"{name}: making again {what}: not what was written there (edited or damaged)")
                    case events.Stopped(text):
                        self.note(f"{name}: {text}")
                    case events.Died():
                        self.note(f"{name}: {event}")
                    case events.Looped():
                        self.note(
                            f"{name}: {event.filter} takes the runs one by one: {event.microseconds:.0f} us a run and "
                            f"step, {event.ratio:.0f} times a Kalman filter on a batch, about "
                            f"{max(event.seconds, 1):.0f} s in all on one core"
                        )
                    case events.Failure():
                        self._failure(name, event, told)
                    case _:
                        advance(event)

            yield listen
        for filter_, count in told.items():
            if count > MOST_FAILURES and not self.verbose:
                self.error(f"{name}: filter {filter_}: {count - MOST_FAILURES} more failures (-v tells all)")

    def _failure(self, name: str, event: Failure, told: Counter[str]) -> None:
        """A filter that raises does so in every block: the first few are enough."""
        told[event.filter] += 1
        if self.verbose:
            self.error(f"{name}: {event}\n{event.traceback}")
        elif told[event.filter] <= MOST_FAILURES:
            self.error(f"{name}: {event}")

    @contextmanager
    def _bar(self, name: str) -> Iterator[Callable[[Event], None]]:
        from rkfbench.study import events

        kept = 0

        def count(event: Event) -> None:
            nonlocal kept
            if isinstance(event, events.BlockDone):
                kept += 1
                self.activity = f"{kept} finished block{'s' if kept != 1 else ''} of {name} kept"

        if self.quiet or not sys.stderr.isatty():

            def plain(event: Event) -> None:
                count(event)
                if isinstance(event, events.CaseDone):
                    self.note(f"{name}: {event.case}: {event.runs} runs, {event.filters} filters")

            yield plain
            return

        from rich import progress
        from rich.console import Console

        columns = (
            progress.TextColumn("{task.description}"),
            progress.BarColumn(),
            progress.MofNCompleteColumn(),
            progress.TextColumn("{task.fields[case]}"),
            progress.TimeRemainingColumn(),
        )
        with progress.Progress(*columns, console=Console(stderr=True, no_color=not self.color or None)) as bar:
            task = bar.add_task(name, total=None, case="")

            def advance(event: Event) -> None:
                count(event)
                if isinstance(event, events.Planned):
                    bar.update(task, total=kept + event.missing)
                elif isinstance(event, events.BlockDone):
                    bar.update(task, advance=1, case=event.case)

            yield advance


def _finite(content: Any) -> Any:
    """The same with None for every number that is not finite."""
    if isinstance(content, Mapping):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(each) for each in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
