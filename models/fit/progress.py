"""What a long fit does at present, for whoever listens, and how long it may go on.

Past the end of its time a fit takes no further step: every solver ends where it is, so that what is
compared, chosen and kept is the best so far, and searches leave out what they have not begun.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from data.terminal import LISTED

_listeners: list[Callable[[str], None]] = []


class Budget:
    """The seconds that a fit may take; what it did when they were spent, and what it left out."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds, self.end = seconds, time.monotonic() + seconds
        self.doing, self.spent_at, self.left_out = "", "", list[str]()

    @property
    def remaining(self) -> float:
        """Seconds that are left; 0 where none are, infinite without an end."""
        return max(0.0, self.end - time.monotonic())

    def begin(self, what: str) -> None:
        """Know what is done now, in a few words."""
        if self.remaining > 0.0:
            self.doing = what

    def facts(self) -> dict[str, str]:
        """In words, what became of a fit that it ended; empty of one that ended by itself."""
        if not self.spent_at and not self.left_out:
            return {}
        names = list(dict.fromkeys(self.left_out))
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        others = f"; not tried: {', '.join(names[:LISTED])}{more}" if names else ""
        last = self.spent_at or "the last step"
        return {"out_of_time": f"{self.seconds:g} s, during {last}{others}"}


_budget = Budget()


def announce(what: str) -> None:
    """Say what is done now, in a few words; from any thread, and often."""
    _budget.begin(what)
    for listener in _listeners:
        listener(what)


@contextmanager
def listening(listener: Callable[[str], None]) -> Iterator[None]:
    """Call the listener with what is done meanwhile."""
    _listeners.append(listener)
    try:
        yield
    finally:
        _listeners.remove(listener)


@contextmanager
def limited(seconds: float | None) -> Iterator[Budget]:
    """Let what is fitted meanwhile take so many seconds; None: as many as it needs."""
    global _budget
    before, _budget = _budget, Budget(math.inf if seconds is None else seconds)
    try:
        yield _budget
    finally:
        _budget = before


@contextmanager
def sharing(parts: int) -> Iterator[None]:
    """Let what is fitted meanwhile take one of so many parts of the time that is left.

    What it left out for want of that is noted as of the whole.
    """
    global _budget
    whole, _budget = _budget, Budget(_budget.remaining / parts)
    _budget.doing = whole.doing
    try:
        yield
    finally:
        part, _budget = _budget, whole
        whole.doing, whole.left_out = part.doing, [*whole.left_out, *part.left_out]
        whole.spent_at = whole.spent_at or part.spent_at


def present_budget() -> Budget:
    """The one that holds now."""
    return _budget


def is_out_of_time() -> bool:
    """Whether the budget is spent: take no further step, and end with the best so far."""
    if _budget.remaining > 0.0:
        return False
    _budget.spent_at = _budget.spent_at or _budget.doing or "the start"
    return True


def leaves_out(what: str) -> bool:
    """Whether there is no time to try this, which is then noted."""
    if not is_out_of_time():
        return False
    _budget.left_out.append(what)
    return True
