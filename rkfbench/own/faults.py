"""Which plug-in an exception came from, and how the user is told."""

from __future__ import annotations

import traceback
from pathlib import Path

from rkfbench.errors import RkfbenchError
from rkfbench.own import names


class PluginFault(RkfbenchError):
    """A plug-in that raised, answered with something of the wrong shape, or changed what it was given."""


def raised(name: str, error: BaseException, where: str = "") -> PluginFault:
    """`my.py:my_filter raised ValueError in run 37, step 12: ... (my.py, line 8)`."""
    return PluginFault(f"{name} raised {type(error).__name__}{where}: {error}{_line(error)}")


def said(error: BaseException) -> str:
    """`LinAlgError: Singular matrix (my.py, line 8)`."""
    return f"{type(error).__name__}: {error}{_line(error)}"


def told(error: BaseException) -> str:
    """What the user reads of an exception in a job: the plug-in that it came from, where there is one."""
    if isinstance(error, RkfbenchError):
        return str(error)
    known = names.files()
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if frame.filename in known:
            return f"{known[frame.filename]} raised {type(error).__name__}: {error}{_line(error)}"
    return f"{type(error).__name__}: {error}"


def _line(error: BaseException) -> str:
    """` (my.py, line 8)`: the last line of a plug-in that the traceback passed."""
    known = names.files()
    passed = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename in known]
    return f" ({Path(passed[-1].filename).name}, line {passed[-1].lineno})" if passed else ""
