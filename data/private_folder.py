"""A folder for what a program keeps between its runs, where nobody else can write.

Whoever can write there decides what the next run does: with the code, else among the user's own
caches, else nowhere.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path


def private_folder(beside: Path, name: str) -> Path | None:
    """A folder of that name in `beside`, or among the user's caches; None where there is none."""
    for base in (beside, _of_the_user()):
        if base is not None and _made_private(base) and _made_private(base / name):
            return base / name
    return None


def _of_the_user() -> Path | None:
    """The user's own caches, as the XDG base directories say; None without a home."""
    named = os.environ.get("XDG_CACHE_HOME", "")
    try:
        caches = Path(named) if os.path.isabs(named) else Path.home() / ".cache"
        caches.mkdir(0o700, parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        return None
    return caches / "structural-model-zoo"


def _made_private(folder: Path) -> bool:
    """Whether this is a folder, made here if need be, that its owner alone, who we are, can write.

    A link is none: it leads where others may decide.
    """
    try:
        folder.mkdir(0o700, exist_ok=True)
        seen = folder.lstat()
    except OSError:
        return False
    if not stat.S_ISDIR(seen.st_mode) or not os.access(folder, os.W_OK):
        return False
    if not hasattr(os, "getuid"):  # Windows: no such bits, and its folders of a user are private
        return True
    return seen.st_uid == os.getuid() and not seen.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
