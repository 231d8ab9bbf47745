"""Memory of a piece of work: whether there is enough, asked before it is begun; large arrays."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING

import numpy as np
import psutil

if TYPE_CHECKING:
    from torch import Tensor

if sys.platform != "win32":
    import resource

SMALL = 16e6  # bytes that are not asked for: to ask takes longer than to simulate for a second
LINE = 64  # bytes that a processor fetches at once
PREFIXES = ("bytes", "kB", "MB", "GB", "TB", "PB", "EB")


def limit_memory() -> None:
    """Leave this process what is available now, where the system knows such limits."""
    if sys.platform != "win32":
        most = psutil.Process().memory_info().vms + int(available_memory())
        resource.setrlimit(resource.RLIMIT_AS, (most, resource.getrlimit(resource.RLIMIT_AS)[1]))


def require_memory(need: float, cause: str, remedy: str) -> None:
    """Raise ValueError where `need` [bytes] is more than the memory that is available now.

    cause: the keys and values that ask for it, such as "data.duration=1e9 at data.dt=0.01";
    remedy: what to change, such as "shorten data.duration".
    """
    if need <= SMALL:
        return
    there = available_memory()
    if not need <= there:
        raise ValueError(
            f"{cause} would take some {amount(need)} of memory, {amount(there)} are there; {remedy}"
        )


def available_memory() -> float:
    """Bytes that this process may still take: the machine's, or what its own limit leaves."""
    there = float(psutil.virtual_memory().available)
    if sys.platform != "win32":
        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            there = min(there, max(0.0, limit - psutil.Process().memory_info().vms))
    return there


def amount(size: float) -> str:
    """A number of bytes as a person says it: 1.3e9 → "1.3 GB"."""
    power = 0
    while size >= 1000.0 and power < len(PREFIXES) - 1:
        size, power = size / 1000.0, power + 1
    return f"{size:.3g} {PREFIXES[power]}"


def empty_array(*shape: int) -> Tensor:
    """An array of float64 without values yet.

    NumPy asks for huge pages, PyTorch does not: large arrays are filled much sooner. The first
    number lies where a line of the cache begins, so that BLAS sums in the same order in any array.
    """
    import torch

    size = math.prod(shape)
    raw = np.empty(size + LINE // 8)
    begin = -raw.ctypes.data % LINE // 8
    return torch.from_numpy(raw[begin : begin + size]).view(shape)
