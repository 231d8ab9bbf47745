"""How the simulation is compiled: numba, without the GIL, cached on disk.

numba's cache knows when the file of a function changes, but not the files of the functions it
calls: a changed law would go on being integrated with the old one. The cache folder is therefore
named after the text of all compiled files together.

numba unpickles what lies in its cache, so whoever can write there runs code here. A folder is used
only where nobody else can write: beside the code, else among the user's own caches, else nowhere.
"""

from __future__ import annotations

import hashlib
import os
import stat
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numba

Compiler = Callable[[Callable[..., Any]], Callable[..., Any]]


def _cache_folder(sources: Sequence[Path]) -> str | None:
    """A folder that nobody else can write to; None where there is none: nothing is cached."""
    text = b"".join(path.read_bytes() for path in sources)
    name = f"numba-{numba.__version__}-{hashlib.sha256(text).hexdigest()[:16]}"
    for base in (sources[0].parent / "__pycache__", _of_the_user()):
        if base is not None and _made_private(base) and _made_private(base / name):
            return str(base / name)
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


def compilers(
    *sources: Path, contract: bool = False, reassociate: bool = False
) -> tuple[Compiler, Compiler]:
    """Two decorators for functions that stand in `sources` and call each other.

    The first compiles at the first call in a fresh clone, later ones read the cache; the second
    compiles into its callers, for functions whose call costs more than they do. `contract` lets
    a product and a sum round once, `reassociate` lets a long sum be taken in parts. No other fast
    mathematics: the same inputs give the same bits in every process, and NaN is found.
    """
    folder = _cache_folder(sources)
    allowed = {name for name, on in (("contract", contract), ("reassoc", reassociate)) if on}

    def compiler(inline: bool) -> Compiler:
        def compile_one(function: Callable[..., Any]) -> Callable[..., Any]:
            before = numba.config.CACHE_DIR
            numba.config.CACHE_DIR = folder or before
            try:
                return numba.njit(
                    cache=folder is not None,
                    nogil=True,
                    error_model="numpy",
                    forceinline=inline,
                    fastmath=allowed or False,
                )(function)
            finally:
                numba.config.CACHE_DIR = before

        return compile_one

    return compiler(False), compiler(True)
