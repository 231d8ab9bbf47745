"""What is done with a far value until it is known whether it was alone.

An outlier is replaced at once. The stream as it was before is kept for some samples: where what
came then lasts, it was an event, such as the first wave of an earthquake; the stream goes back and
through these samples again, learning from all of them. Only the estimates made meanwhile stay.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from models.online.guard import Watch


class Holdable(Protocol):
    """A stream, as far as it is held."""

    watch: Watch

    def snapshot(self) -> dict[str, Any]:
        """All that a sample changes, as it is now."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot, which must not be used again."""


class Hold:
    """A stream before an outlier, and the calls since. Begins the window of its ranges."""

    def __init__(self, stream: Holdable) -> None:
        self.before = stream.snapshot()
        self.calls: list[tuple[Callable[[Any], Any], Any]] = []
        stream.watch.ranges.watch()

    def decided(self, stream: Holdable) -> Hold | None:
        """None where all is decided; an event is gone through again, and believed."""
        limits = stream.watch.ranges.event()
        if limits is None:
            return self if stream.watch.ranges.left else None
        stream.restore(self.before)
        ranges = stream.watch.ranges
        ranges.limits = limits
        for call, argument in self.calls:
            call(argument)
        ranges.limits = None
        return None
