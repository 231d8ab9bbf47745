"""How long a piece of work takes, call by call."""

from __future__ import annotations

import time
from collections.abc import Callable


def seconds_of(work: Callable[[], object], repeats: int) -> list[float]:
    """Seconds of each of some calls, after a first one that compiles."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return times
