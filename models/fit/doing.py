"""What a long identification is about, told to whoever listens: a line on the screen."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

_listeners: list[Callable[[str], None]] = []


def doing(what: str) -> None:
    """Tell what is done now, in a few words; from any thread, and often."""
    for listener in _listeners:
        listener(what)


@contextmanager
def heard(listener: Callable[[str], None]) -> Iterator[None]:
    """Call the listener with what is done meanwhile."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)
