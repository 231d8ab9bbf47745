"""One process at a time in a folder. The kernel keeps the locks: they end with their process.

The lock of a run is .lock in its folder, from its beginning to its end; that of a sweep .sweep.lock
in the sweep's. The files say who works there. One that a killed process left holds nothing.
"""

from __future__ import annotations

import errno
import os
import platform
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from data.whole_file import read_regular

RUN, SWEEP = ".lock", ".sweep.lock"
WITHOUT = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # of a file system that has no locks
_held: dict[Path, tuple[int, FileLock]] = {}  # process and lock by folder, of runs


class HeldError(ValueError):
    """Somebody else works in the folder; nothing in it was touched."""


def hold(folder: Path) -> None:
    """Hold a run's folder until `release_all` or the end of this process; twice is once.

    Raises HeldError where another process holds it.
    """
    place = folder.resolve()
    if _held.get(place, (0, None))[0] != os.getpid():
        _held[place] = os.getpid(), _acquired(place / RUN, "hydra.run.dir")


def release(folder: Path) -> None:
    """Let go of a run's folder, if this process holds it."""
    process, lock = _held.pop(folder.resolve(), (0, None))
    if lock is not None and process == os.getpid():
        _let_go(lock)


def release_all() -> None:
    """Let go of every run's folder."""
    for folder in list(_held):
        release(folder)


@contextmanager
def sweep_held(folder: Path) -> Iterator[None]:
    """Hold a sweep's folder. Raises HeldError where another command does."""
    lock = _acquired(folder.resolve() / SWEEP, "hydra.sweep.dir")
    try:
        yield
    finally:
        _let_go(lock)


def _acquired(path: Path, key: str) -> FileLock:
    # within a second the processes of a command that was killed end
    lock = FileLock(path, timeout=1.0, thread_local=False, fallback_to_soft=False)
    try:
        lock.acquire()
    except Timeout:
        raise HeldError(
            f"{path.parent} is in use by {_holder(path)}; wait until that has ended, or choose "
            f"another {key}"
        ) from None
    except OSError as error:
        if error.errno not in WITHOUT:
            raise
        print(
            f"no locks on the file system of {path.parent}: let no other command work there",
            file=sys.stderr,
        )
        return lock
    if path.is_file():
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        path.write_text(f"process {os.getpid()} on {platform.node()} since {since}", "utf-8")
    return lock


def _let_go(lock: FileLock) -> None:
    """Remove the file and then the lock: who opened the file meanwhile sees that it is gone."""
    if lock.is_locked:
        with suppress(OSError):  # Windows removes no open file
            os.unlink(lock.lock_file)
    lock.release()


def _holder(path: Path) -> str:
    """Who holds a lock, as its file says."""
    try:
        return read_regular(path, 200).decode("utf-8") or "another process"
    except (ValueError, OSError):
        return "another process"
