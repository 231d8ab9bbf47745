"""Compiled work that may take long, done so that Ctrl-C is heard meanwhile."""

from __future__ import annotations

import threading
from collections.abc import Callable

BLINK = 10_000_000  # inner steps of compiled work, some tenths of a second


def interruptible(work: Callable[[], object], steps: int) -> None:
    """Call compiled `work` that holds no lock; in a separate thread if it takes long.

    Python hears Ctrl-C only between two Python statements, and compiled work is one of them.
    The thread of a call that was broken off ends with its work, or with the program.
    """
    if steps <= BLINK:
        work()
        return
    failed: list[BaseException] = []

    def watched() -> None:
        try:
            work()
        except BaseException as error:  # handed to the caller
            failed.append(error)

    thread = threading.Thread(target=watched, daemon=True)
    thread.start()
    while thread.is_alive():
        thread.join(0.1)
    if failed:
        raise failed[0]
