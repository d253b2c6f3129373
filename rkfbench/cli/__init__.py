"""The command `rkfbench`: parse, call, print, exit code. The only part that prints or exits.

Everything heavy is imported inside the commands, so that `rkfbench --help` answers at once.
"""

from __future__ import annotations

import gc
import os
import sys

from rkfbench import blas


def main() -> None:
    """Entry point of the command."""
    gc.set_threshold(100_000)  # modules and tables stay: looking for garbage among them takes a tenth of the start
    blas.one_thread()
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # pydantic would search every installed package
    try:
        from rkfbench.cli.commands import app

        app(prog_name="rkfbench")
    except KeyboardInterrupt:
        sys.exit(130)
