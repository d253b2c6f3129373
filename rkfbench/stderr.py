"""The standard error: it takes what it can, and what plug-ins print goes there, since standard output is for results.

What is told on the way is worth less than what is computed, so a full disk or a terminal that went away ends nothing.
"""

from __future__ import annotations

import io
import os
import sys
from contextlib import suppress
from typing import TextIO


class Patient(io.TextIOWrapper):
    """A text stream that drops what cannot be written."""

    def write(self, text: str) -> int:
        try:
            return super().write(text)
        except OSError:
            return len(text)

    def flush(self) -> None:
        with suppress(OSError):
            super().flush()


def patient() -> None:
    """From now on nothing that is written to the standard error raises."""
    if sys.stderr is None:  # closed (`2>&-`, a daemon)
        sys.stderr = nowhere()
    elif isinstance(sys.stderr, io.TextIOWrapper):
        stream = sys.stderr  # a terminal may lack a character, and a file name be no text: hence the escapes
        sys.stderr = Patient(stream.buffer, encoding=stream.encoding, errors="backslashreplace", line_buffering=True)


def nowhere() -> TextIO:
    """In the place of a stream that is closed, for which Python has None."""
    return open(os.devnull, "w")


def all_there() -> None:
    """In a process that has no results to print: whatever is printed goes to the standard error."""
    patient()
    sys.stdout = sys.stderr
