"""What two workers need at once is compiled by one; the other waits, and reads numba's cache."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock
from numba.core import event
from numba.core.ccallback import CFunc
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher


def _in_turn(compile_one: Callable[..., Any]) -> Callable[..., Any]:
    """As numba does, which looks into its cache first; other processes wait until it has ended."""

    def compile_alone(compiled: Any, *signature: Any) -> Any:
        cache = compiled._cache
        if not cache.cache_path or not Path(cache.cache_path).is_dir():
            return compile_one(compiled, *signature)
        place = Path(cache.cache_path) / f"{cache._impl.filename_base}.lock"
        # threads of this process first: else one could wait for a file that another thread has
        with global_compiler_lock, FileLock(place, is_singleton=True):
            return compile_one(compiled, *signature)

    return compile_alone


def compile_in_turn() -> None:
    """From here on, in this process.

    numba's timers of its locks, which nobody reads, take a sixth of the time of compiling.
    """
    Dispatcher.compile = _in_turn(Dispatcher.compile)
    CFunc.compile = _in_turn(CFunc.compile)
    event.broadcast = lambda timed: None
