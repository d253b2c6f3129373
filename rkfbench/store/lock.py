"""One run at a time in a results folder.

The lock is the kernel's (`flock`), so it goes away with the process that held it, however that process ended: a lock
that was left behind by a dead process needs no recognising.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rkfbench.errors import UsageError
from rkfbench.store import files

NAME = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold `folder` (made if it is not there) for one run; UsageError when another process holds it."""
    with files.writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = _acquire(folder)
    try:
        files.remove_leftovers(folder)
        yield
    finally:
        (folder / NAME).unlink(missing_ok=True)
        os.close(handle)


def _acquire(folder: Path) -> int:
    path = folder / NAME
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(handle, 32).decode(errors="replace") or "unknown"
            os.close(handle)
            raise UsageError(
                f"{folder} is in use by another run (process {owner}): wait for it, or choose another folder with --out"
            ) from None
        if _is_still(path, handle):
            os.truncate(handle, 0)
            os.write(handle, str(os.getpid()).encode())
            return handle
        os.close(handle)  # its last owner removed the file between our open and our lock


def _is_still(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except FileNotFoundError:
        return False
