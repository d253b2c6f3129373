"""One run at a time in a results folder, or any number of shards, which write different blocks and nothing else.

The lock is the kernel's (`flock`), so it goes away with the process that held it, however that process ended: a lock
that was left behind by a dead process needs no recognising. Shards hold it shared. On a file system that knows no
locks shards go without: whole files under names of their own are safe there too.
"""

from __future__ import annotations

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rkfbench.errors import UsageError
from rkfbench.store import files

NAME = ".lock"
WITHOUT = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)  # answers of a file system that has no locks


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold `folder` (made if it is not there) for one run; UsageError when another process holds it."""
    with files.writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = _acquire(folder, fcntl.LOCK_EX)
    try:
        files.remove_leftovers(folder)
        yield
    finally:
        (folder / NAME).unlink(missing_ok=True)
        os.close(handle)


@contextmanager
def shared(folder: Path) -> Iterator[None]:
    """Hold `folder` together with other shards; UsageError when a run holds it alone."""
    with files.writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        try:
            handle = _acquire(folder, fcntl.LOCK_SH)
        except OSError as error:
            if error.errno not in WITHOUT:
                raise
            handle = None
    try:
        yield
    finally:
        if handle is not None:
            os.close(handle)  # the file stays: others may hold it


def _acquire(folder: Path, kind: int) -> int:
    path = folder / NAME
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(handle, 32).decode(errors="replace")
            os.close(handle)
            whose = f"another run (process {owner})" if owner else "shards of a run, or another run"
            raise UsageError(
                f"{folder} is in use by {whose}: wait for the end, or choose another folder with --out"
            ) from None
        except OSError:
            os.close(handle)
            raise
        if _is_still(path, handle):
            os.truncate(handle, 0)
            if kind == fcntl.LOCK_EX:
                os.write(handle, str(os.getpid()).encode())
            return handle
        os.close(handle)  # its last owner removed the file between our open and our lock


def _is_still(path: Path, handle: int) -> bool:
    try:
        return os.path.samestat(os.stat(path), os.fstat(handle))
    except FileNotFoundError:
        return False
