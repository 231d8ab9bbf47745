"""How the simulation is compiled: numba, without the GIL, cached on disk.

numba's cache knows when the file of a function changes, but not the files of the functions it
calls: a changed law would go on being integrated with the old one. The cache folder is therefore
named after the text of all compiled files together.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba

HERE = Path(__file__).parent


def _cache_folder() -> str:
    text = b"".join((HERE / name).read_bytes() for name in ("elements.py", "integrator.py"))
    base = HERE / "__pycache__"
    if not os.access(base if base.exists() else HERE, os.W_OK):
        base = Path(tempfile.gettempdir()) / f"numba-cache-{os.getuid()}"
    return str(base / f"numba-{numba.__version__}-{hashlib.sha256(text).hexdigest()[:16]}")


CACHE_FOLDER = _cache_folder()


def _compile(function: Callable[..., Any], inline: bool) -> Callable[..., Any]:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = CACHE_FOLDER
    try:  # no fastmath: the same inputs give the same bits in every process
        return numba.njit(cache=True, nogil=True, error_model="numpy", forceinline=inline)(function)
    finally:
        numba.config.CACHE_DIR = before


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function compiled at its first call in a fresh clone, read from the cache afterwards."""
    return _compile(function, inline=False)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compiled into its callers: for functions whose call costs more than they do."""
    return _compile(function, inline=True)
