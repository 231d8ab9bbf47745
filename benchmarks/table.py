"""Times of repeated work, and tables of text as the benchmarks print them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence


def seconds_of(work: Callable[[], object], repeats: int) -> list[float]:
    """Seconds of each of some calls, after a first one that compiles."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return times


def show(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a row as soon as it is there, the first column to the left, the others to the right."""
    widths = [max(len(name), 9) for name in head]
    widths[0] = max(80 - sum(widths[1:]) - 2 * len(widths[1:]), len(head[0]))
    if title:
        print(f"\n{title}\n")
    _print(head, widths)
    for row in rows:
        _print(row, widths)


def _print(row: Sequence[object], widths: Sequence[int]) -> None:
    first, *others = (str(cell) for cell in row)
    cells = [cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)]
    print("  ".join([first.ljust(widths[0]), *cells]).rstrip(), flush=True)
