"""What all commands share: the options about output, and how an exception becomes a message and an exit code."""

from __future__ import annotations

import inspect
import os
import sys
import traceback
from collections.abc import Callable
from contextlib import redirect_stdout
from functools import wraps
from typing import Annotated, Any, get_type_hints

import typer

from rkfbench import interrupts
from rkfbench.cli import INTERRUPTED
from rkfbench.cli.terminal import Terminal, written
from rkfbench.errors import RkfbenchError, UsageError

LONGEST = 200  # characters of a file name in a message
OUTPUT: dict[str, Any] = {
    "as_json": Annotated[bool, typer.Option("--json", help="Print data as JSON.")],
    "quiet": Annotated[bool, typer.Option("-q", "--quiet", help="Print only data and errors.")],
    "verbose": Annotated[bool, typer.Option("-v", "--verbose", help="Print tracebacks.")],
    "no_color": Annotated[bool, typer.Option("--no-color", help="No colours (also: environment variable NO_COLOR).")],
}


def command(function: Callable[..., None]) -> Callable[..., None]:
    """Make a command of a function whose first parameter is the terminal: adds the options about output.

    Whatever the function raises ends the command with one clear message and the exit code of the error; a traceback is
    shown only with -v.
    """

    @wraps(function)
    def run(*, as_json: bool, quiet: bool, verbose: bool, no_color: bool, **params: Any) -> None:
        color = not (no_color or os.environ.get("NO_COLOR"))
        terminal = Terminal(as_json, quiet, verbose, color=color, out=sys.stdout)
        try:
            with redirect_stdout(sys.stderr):  # what a plug-in prints is no result
                function(terminal, **params)
            with written():
                terminal.out.flush()
        except typer.Exit:
            raise
        except BrokenPipeError:  # the reader of a pipe (head, less) went away: nothing to tell
            os.dup2(os.open(os.devnull, os.O_WRONLY), terminal.out.fileno())
            raise typer.Exit(0) from None
        except (Exception, KeyboardInterrupt) as error:
            if interrupts.came() or isinstance(error, KeyboardInterrupt):  # some libraries make another error of it
                interrupts.ignore()  # a second one would only interrupt the answer to the first
                kept = f"; {terminal.activity}" if terminal.activity else ""
                terminal.error(f"interrupted{kept}: the same command goes on from there")
                raise typer.Exit(INTERRUPTED) from None
            if verbose:
                terminal.error(traceback.format_exc())
            elif isinstance(error, RkfbenchError):
                terminal.error(str(error))
            elif isinstance(error, OSError) and error.filename is not None:
                terminal.error(f"cannot use {str(error.filename)[:LONGEST]}: {error.strerror}")
                raise typer.Exit(UsageError.exit_code) from None
            else:
                terminal.error(
                    f"{type(error).__name__}: {error}\nnot expected: run again with -v to see where it happened"
                )
            raise typer.Exit(error.exit_code if isinstance(error, RkfbenchError) else 1) from None

    hints = get_type_hints(function, include_extras=True)
    signature = inspect.signature(function)
    own = [each.replace(annotation=hints[name]) for name, each in list(signature.parameters.items())[1:]]
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=hint)
        for name, hint in OUTPUT.items()
    ]
    run.__signature__ = signature.replace(parameters=[*own, *options])  # type: ignore[attr-defined]
    run.__annotations__ = {each.name: each.annotation for each in [*own, *options]}
    return run
