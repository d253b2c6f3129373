"""The command `rkfbench`: parse, call, print, exit code. The only part that prints or exits.

Everything heavy is imported inside the commands, so that `rkfbench --help` answers at once.
"""

from __future__ import annotations

import contextlib
import gc
import io
import os
import sys
from typing import NoReturn

from rkfbench import blas, interrupts
from rkfbench.pool import COLLECT

INTERRUPTED = 130  # exit code, as shells have it


def main() -> None:
    """Entry point of the command."""
    interrupts.insist()
    gc.set_threshold(COLLECT)  # a tenth of the start, otherwise
    blas.one_thread()
    sys.unraisablehook = _unraisable
    for stream in (sys.stdout, sys.stderr):  # a terminal that lacks a character, or a file name that is no text
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # pydantic would search every installed package
    try:
        from rkfbench.cli.commands import app

        app(prog_name="rkfbench")
    except KeyboardInterrupt:
        _leave(INTERRUPTED)
    except SystemExit as ended:
        if ended.code and interrupts.came():
            _leave(INTERRUPTED)
        raise
    finally:  # all is said and written: a Ctrl-C while Python ends does not change the exit code any more
        interrupts.ignore()


def _leave(code: int) -> NoReturn:
    """End at once: what was interrupted anywhere need not be fit for the end that Python makes (it may abort)."""
    interrupts.ignore()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):  # a reader that has gone
            stream.flush()
    os._exit(code)


def _unraisable(told: sys.UnraisableHookArgs) -> None:
    """A Ctrl-C that met a destructor or a callback, from where nothing can be raised, needs no word: it comes again."""
    if told.exc_type is not KeyboardInterrupt:
        sys.__unraisablehook__(told)
