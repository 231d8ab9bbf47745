"""Compiled work on several cores: it holds no lock, hears Ctrl-C, is the same to the bit on any."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from threading import Thread
from typing import TypeVar

import torch

BLINK = 10_000_000  # inner steps of compiled work, some tenths of a second


def interruptible(work: Callable[[], object], steps: int) -> None:
    """Call compiled `work` that holds no lock; in a separate thread if it takes long.

    Python hears Ctrl-C only between two Python statements, and compiled work is one of them.
    The thread of a call that was broken off ends with its work, or with the program.
    """
    if steps <= BLINK:
        work()
    else:
        _in_threads(work, 1)


def _in_threads(work: Callable[[], object], count: int, here: bool = False) -> None:
    """Call `work` in so many threads, in this one too with `here`; raises what it raises."""
    failed: list[BaseException] = []

    def watched() -> None:
        try:
            work()
        except BaseException as error:  # handed to the caller
            failed.append(error)

    taken = [Thread(target=watched, daemon=True) for _ in range(count)]
    for thread in taken:
        thread.start()
    if here:
        watched()
    for thread in taken:
        while thread.is_alive():
            thread.join(0.1)
    if failed:
        raise failed[0]


Item = TypeVar("Item")
Result = TypeVar("Result")


def _cores() -> int:
    """Those that this process may use; OMP_NUM_THREADS counts here as it does for BLAS."""
    stated = os.environ.get("OMP_NUM_THREADS", "")
    if stated.isdecimal() and int(stated) > 0:
        return int(stated)
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


CORES = _cores()
_limit: int | None = None


def take_threads(threads: int | None) -> None:
    """So many threads for compiled work and PyTorch; None: all cores, and one for PyTorch."""
    global _limit
    _limit = threads
    torch.set_num_threads(threads or 1)


def threads() -> int:
    """Number of threads that compiled work may take."""
    return CORES if _limit is None else _limit


def in_threads(
    work: Callable[[Item], Result], items: Sequence[Item], steps: int = BLINK + 1
) -> list[Result]:
    """Results of compiled `work` on every item, in their order; each takes a number of inner steps.

    Ctrl-C is heard meanwhile. The threads of a call that was broken off end with their work, or
    with the program. This thread works, too, where an item is done in a blink: a new one may wait
    milliseconds for a core.
    """
    number = min(threads(), len(items))
    if number < 2:
        return [work(item) for item in items]
    results: dict[int, Result] = {}
    left = iter(range(len(items)))

    def some() -> None:
        try:
            for number in left:
                results[number] = work(items[number])
        except BaseException:
            list(left)  # nothing is begun any more
            raise

    short = steps <= BLINK
    _in_threads(some, number - short, here=short)
    return [results[number] for number in range(len(items))]
