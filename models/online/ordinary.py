"""A guard's state as arrays, for as long as samples are as they should be."""

from __future__ import annotations

from math import inf

import numpy as np

from models.online.guard import Watch
from models.online.guard_compiled import BEFORE, LARGEST, MEASURED, MISSED, ROWS, SAME

RANGE = ("last", "level", "step", "quantum", "error")  # the first rows, of `Range`


class Ordinary:
    """The numbers of a `Watch` that the compiled step reads and changes, one column a channel.

    They are the watch's own from `take` to `hand_back`; in between it counts samples alone.
    """

    def __init__(self, watch: Watch, inputs: int) -> None:
        guard, dofs = watch.guard, len(watch.before)
        times = inf if guard.outlier is None else guard.outlier
        self.limits = np.array([times, guard.full_scale, guard.repeats])
        self.numbers = {"f": np.zeros((len(ROWS), inputs)), "a": np.zeros((len(ROWS), dofs))}
        self.taken = False

    def take(self, watch: Watch) -> bool:
        """Whether the next sample may be an ordinary one; the numbers are then taken over."""
        ranges = watch.ranges
        waiting = ranges.young, ranges.first, ranges.left, watch.blind, watch.unsettled
        if any(waiting) or watch.bad or watch.repeats or ranges.of.keys() != self.numbers.keys():
            return False
        for name, numbers in self.numbers.items():
            for j, one in enumerate(ranges.of[name]):
                numbers[: len(RANGE), j] = [getattr(one, row) for row in RANGE]
        own = self.numbers["a"]
        own[BEFORE], own[SAME], own[LARGEST] = watch.before, watch.same, watch.largest
        own[MISSED], own[MEASURED] = watch.missed, watch.measured
        watch.still_bad = set()
        self.taken = True
        return True

    def hand_back(self, watch: Watch) -> None:
        """Give the watch its numbers."""
        for name, numbers in self.numbers.items():
            for one, values in zip(watch.ranges.of[name], numbers.T.tolist(), strict=True):
                for row, value in zip(RANGE, values[: len(RANGE)], strict=True):
                    setattr(one, row, value)
        own = self.numbers["a"].tolist()
        watch.before, watch.same = own[BEFORE], list(map(int, own[SAME]))
        watch.largest, watch.missed, watch.measured = (own[k] for k in (LARGEST, MISSED, MEASURED))
        self.taken = False
