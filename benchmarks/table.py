"""Times of repeated work, settings half and double, tables of text as the benchmarks print them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

from models.fit.race import Settings

SETTINGS = ("draws", "iterations", "goes_on", "kept", "kinds", "last")


def seconds_of(work: Callable[[], object], repeats: int) -> list[float]:
    """Seconds of each of some calls, after a first one that compiles."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return times


def varied(settings: Settings) -> Iterator[tuple[str, Settings]]:
    """The settings of a race, then each of them half and double."""
    yield "as they are", settings
    for name in SETTINGS:
        value: Any = getattr(settings, name)
        for word, factor in (("half", 0.5), ("double", 2.0)):
            if isinstance(value, tuple):
                other: Any = tuple(int(factor * part) for part in value)
            else:
                other = type(value)(factor * value)
            yield f"{name}, {word}", replace(settings, **{name: other})


def show(title: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table of 80 columns, each row once it is there: names to the left, numbers aligned.

    A name that is too long for its column has a separate line.
    """
    widths = [max(len(name), 9) for name in head[1:]]
    room = max(80 - sum(widths) - 2 * len(widths), 1)
    if title:
        print(f"\n{title}\n")
    _print(head, room, widths)
    for row in rows:
        _print(row, room, widths)


def _print(row: Sequence[object], room: int, widths: Sequence[int]) -> None:
    first, *others = (str(cell) for cell in row)
    if len(first) > room:
        print(first)
        first = ""
    cells = [cell.rjust(width) for cell, width in zip(others, widths, strict=True)]
    print("  ".join([first.ljust(room), *cells]).rstrip(), flush=True)
