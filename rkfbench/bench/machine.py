"""What a table of times must say of the machine: processor, compiler, versions, threads, how busy it was."""

from __future__ import annotations

import os
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from rkfbench.bench import kernels

PACKAGES = ("numpy", "jax", "dynamax", "simdkalman", "filterpy", "pykalman", "stonesoup")


def facts() -> dict[str, str]:
    """Facts by name; no host, no paths."""
    return {
        "processor": f"{processor()}, {os.cpu_count()} cores seen",
        "versions": ", ".join([f"Python {platform.python_version()}", *filter(None, map(_version, PACKAGES))]),
        "C": compiler(),
    }


def processor() -> str:
    """The processor's name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


def compiler() -> str:
    """The C compiler's own name for itself, and the flags."""
    cc = kernels.compiler()
    if cc is None:
        return "no compiler"
    told = subprocess.run([cc, "--version"], capture_output=True, text=True, check=False).stdout.splitlines()
    flags = " ".join(flag for flag in kernels.FLAGS if flag not in ("-fPIC", "-shared"))
    return f"{told[0] if told else 'unknown compiler'}; {flags}, no -ffast-math"


def load() -> float:
    """How many processes wanted to run, on average over the last minute."""
    return os.getloadavg()[0]


def _version(package: str) -> str:
    try:
        return f"{package} {version(package)}"
    except PackageNotFoundError:
        return ""
