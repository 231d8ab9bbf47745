"""What is done with a far value until it is known whether it was alone.

An outlier is replaced at once. The stream as it was before is kept for some samples: where what
came then lasts, it was an event, such as the first wave of an earthquake; the stream goes back and
through these samples again, learning from all of them. Only the estimates made meanwhile stay.

The first samples in motion, which nothing can be compared with, are held the other way round: they
are learnt from as they come, and gone through again without those that prove outliers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from models.online.guard import Watch
from models.online.laws.law import Law
from models.online.outliers import PATIENCE


class Holdable(Protocol):
    """A stream, as far as it is held."""

    watch: Watch
    law: Law

    def snapshot(self) -> dict[str, Any]:
        """All that a sample changes, as it is now."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot, which must not be used again."""


class Hold:
    """A stream before an outlier or its first motion, and the calls since, with their law."""

    def __init__(self, stream: Holdable) -> None:
        self.before = stream.snapshot()
        self.calls: list[tuple[Law, Callable[[Any], Any], Any]] = []
        stream.watch.ranges.watch()

    def decided(self, stream: Holdable) -> Hold | None:
        """None where all is decided; what is then known is held to in going through it again."""
        ranges = stream.watch.ranges
        limits = ranges.of_first() if ranges.first else ranges.event()
        if ranges.first and len(self.calls) > 2 * PATIENCE:
            limits = {}
        if limits is None:
            return self if ranges.left or ranges.first else None
        if ranges.first and not limits:
            ranges.first, ranges.window = False, {}
            return None
        stream.restore(self.before)
        ranges, law = stream.watch.ranges, stream.law
        ranges.limits = limits
        for stream.law, call, argument in self.calls:
            call(argument)
        ranges.limits, stream.law = None, law
        stream.watch.replays += 1
        return None
