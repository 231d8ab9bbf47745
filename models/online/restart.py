"""A model that does worse than no estimate at all begins anew, where a new beginning does better.

Σ (a − â)² > Σ a² over a stretch says that something in the past has ruined the weights, or that
nothing can be estimated here, as of noise. The two differ in what a new beginning does: a rival in
the first state of the stream learns for one stretch, is compared over the next one, and takes over
if the square of its error is less than half. So a hopeless model never restarts, in a loop or once.
After each rival that was no better the pause doubles: a stream of noise soon costs no more than any
other.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import TYPE_CHECKING

from models.online.laws.law import Adapted

if TYPE_CHECKING:
    from models.online.stream import Stream

STRETCH = 200  # samples; twice the weights of a VWNN of three DOFs
SELDOM = 64  # stretches between two rivals at the most
QUIET = 0.1  # of the strongest motion that was estimated well: a weaker one ruins no model
BETTER = 0.5  # part of the square of the error


class Restart:
    """When a stream is reviewed next, its first states, and its rival while there is one."""

    def __init__(self, states: Sequence[Adapted]) -> None:
        self.states = list(states)
        self.due: float = STRETCH  # number of the sample
        self.since = 0  # number of the sample of the last review
        self.rival: Stream | None = None
        self.learns = False  # the rival, in its first stretch
        self.pause = 1  # stretches until the next rival
        self.known = 0.0  # Σ a² a sample, the largest that was estimated well

    def review(self, stream: Stream) -> None:
        """Compare a stream with none and with its rival, over the samples since the last review."""
        rival, watch = self.rival, stream.watch
        if stream.holds or (rival is not None and rival.holds):
            return  # the next sample will do
        missed, measured = stream.squares()
        samples, self.due = watch.sample - self.since, watch.sample + STRETCH
        self.since = watch.sample
        if missed < BETTER * measured:
            self.known = max(self.known, measured / samples)
        if missed <= max(measured, QUIET**2 * self.known * samples):
            self.rival, self.pause = None, 1
        elif rival is None:
            self.rival, self.learns = stream.begin_anew(), True
        elif self.learns:
            self.learns = False
            rival.squares()
        else:
            self._decide(stream, rival, missed, measured)

    def _decide(self, stream: Stream, rival: Stream, missed: float, measured: float) -> None:
        """Let the rival take over if it is better; else wait twice as long for the next one."""
        own, moved = rival.squares()
        self.rival = None
        if not isfinite(own) or own * measured >= BETTER * missed * moved:
            self.pause = min(2 * self.pause, SELDOM)
            self.due = stream.watch.sample + STRETCH * self.pause
            return
        stream.take_over(rival)
        self.pause, self.known = 1, 0.0
