"""The C kernels, compiled on the spot: `cc -O3 -march=native`, without -ffast-math.

The plain ones filter one run after the other with sizes fixed when they are compiled, and stand for what a good C
programmer writes in an afternoon: no intrinsics, no threads. The same text compiled with LANES filters 8 runs at once
in vectors of 8 doubles, which comes nearer to what the processor can do.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

LANES = 8
FLAGS = ("-O3", "-march=native", "-std=c11", "-fPIC", "-shared")
DOUBLES = ctypes.POINTER(ctypes.c_double)
SOURCES = Path(__file__).parent / "c"


def compiler() -> str | None:
    """The C compiler: $CC, or cc; None where there is none."""
    return shutil.which(os.environ.get("CC", "cc"))


def refusal() -> str | None:
    """Why there are no kernels on this machine; None if there are."""
    if compiler() is None:
        return "no C compiler"
    try:
        for name in ("linear", "altitude", "particle"):
            library(name)
    except subprocess.CalledProcessError as error:
        return f"the C compiler refuses them: {error.stderr.decode(errors='replace').strip().splitlines()[:1]}"
    return None


@cache
def library(name: str, lanes: int = 1) -> ctypes.CDLL:
    """The compiled file c/NAME.c, for so many runs at once. CalledProcessError where it does not compile."""
    cc = compiler()
    if cc is None:
        raise FileNotFoundError("no C compiler")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / f"{name}.so"
        define = [f"-DLANES={lanes}", "-fno-math-errno"] if lanes > 1 else []
        command = [cc, *FLAGS, *define, "-o", str(out), str(SOURCES / f"{name}.c"), "-lm"]
        subprocess.run(command, check=True, capture_output=True)
        return ctypes.CDLL(str(out))


def bound(library: ctypes.CDLL, function: str, *arguments: Any) -> Callable[[], None]:
    """The call of a kernel with these arguments: whole numbers, real numbers, arrays, and lists of arrays for structs
    of pointers. What it is given stays alive with it.
    """
    kernel = getattr(library, function)
    kernel.restype, kernel.argtypes = None, None
    converted = [_converted(each) for each in arguments]
    return lambda: kernel(*converted)


def _converted(value: Any) -> Any:
    if isinstance(value, int):
        return ctypes.c_long(value)
    if isinstance(value, float):
        return ctypes.c_double(value)
    if isinstance(value, list):
        return (DOUBLES * len(value))(*(_converted(each) for each in value))
    return ctypes.cast(np.ctypeslib.as_ctypes(value.reshape(-1)), DOUBLES)
