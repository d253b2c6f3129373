"""The command `rkfbench`: parse, call, print, exit code. The only part that prints or exits.

Everything heavy is imported inside the commands, so that `rkfbench --help` answers at once.
"""

from __future__ import annotations

import gc
import io
import os
import sys
from typing import NoReturn

from rkfbench import blas, interrupts, stderr
from rkfbench.pool import COLLECT

INTERRUPTED = 130  # exit code, as shells have it


def main() -> None:
    """Entry point of the command."""
    interrupts.insist()
    gc.set_threshold(COLLECT)  # a tenth of the start, otherwise
    blas.one_thread()
    sys.unraisablehook = _unraisable
    stderr.patient()
    sys.stdout = sys.stdout or stderr.nowhere()
    if isinstance(sys.stdout, io.TextIOWrapper):  # a terminal that lacks a character, or a file name that is no text
        sys.stdout.reconfigure(errors="backslashreplace")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # pydantic would search every installed package
    try:
        from rkfbench.cli.commands import app

        app(prog_name="rkfbench")
    except KeyboardInterrupt:
        _leave(INTERRUPTED)
    except SystemExit as ended:
        _leave(INTERRUPTED if ended.code and interrupts.came() else int(ended.code or 0))
    except OSError as error:  # commands tell their own: it is the help that cannot be written
        print(f"cannot write to the standard output: {error.strerror}", file=sys.stderr)
        _leave(1)


def _leave(code: int) -> NoReturn:
    """End at once. All is said and written, so the end that Python makes would only take time (a tenth of a second for
    a short command), and what was interrupted anywhere need not be fit for it (it may abort).
    """
    interrupts.ignore()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # a full disk, a reader that has gone
            code = code or 1
    os._exit(code)


def _unraisable(told: sys.UnraisableHookArgs) -> None:
    """A Ctrl-C that met a destructor or a callback, from where nothing can be raised, needs no word: it comes again."""
    if told.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(told)
