"""Compiled work on several cores: it holds no lock, and is the same to the bit on any thread."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import torch

Item = TypeVar("Item")
Result = TypeVar("Result")


def _cores() -> int:
    """Those that this process may use; OMP_NUM_THREADS counts here as it does for BLAS."""
    told = os.environ.get("OMP_NUM_THREADS", "")
    if told.isdecimal() and int(told) > 0:
        return int(told)
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


def in_threads(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Results of compiled `work` on every item, in their order."""
    workers = min(threads(), len(items))
    if workers < 2:
        return [work(item) for item in items]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(work, items))
