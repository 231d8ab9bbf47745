"""Time stamps of live samples → seconds since the first sample."""

from __future__ import annotations

from itertools import pairwise
from math import isfinite
from statistics import median

PATIENCE = 100  # samples behind the newest, then the clock is taken for set back
LEAP = 3600.0  # [s]; a longer step is a clock set ahead, not a silent sensor
CHECKED = 20  # first steps that are compared with the stated rate


class TimeStamps:
    """Seconds since the first sample; a missing stamp is one step after its predecessor.

    Stamps that repeat or lie behind the newest are passed on unchanged, for the stream to report.
    Where stamps stay behind, or leap far ahead, the sensors' clock was set: time then goes on from
    its newest value. Raises ValueError where the first steps differ from dt [s] by half of it.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.time = -dt  # [s] of the newest sample
        self.origin: float | None = None  # stamp at time 0
        self.behind = 0
        self.note = ""  # how the newest stamp was changed, "" if it was not
        self._stamps: list[float] = []  # the first stamps

    def __call__(self, stamp: float | None) -> float:
        """Time [s] of the next sample, whose stamp [s] may be missing."""
        self.note = ""
        if stamp is None or not isfinite(stamp):
            return self._advance(self.time + self.dt)
        if self.origin is None:
            self.origin = stamp - (self.time + self.dt)
        time = stamp - self.origin
        self._check_rate(stamp)
        if self.time < time < self.time + LEAP:
            return self._advance(time)
        self.behind += time <= self.time
        if time <= self.time and self.behind <= PATIENCE:
            return time
        self.note = f"the clock was set, by {time - self.time:g} s; time goes on from there"
        self.origin = stamp - (self.time + self.dt)
        return self._advance(self.time + self.dt)

    def _advance(self, time: float) -> float:
        self.time, self.behind = time, 0
        return time

    def _check_rate(self, stamp: float) -> None:
        if len(self._stamps) > CHECKED:
            return
        self._stamps.append(stamp)
        if len(self._stamps) > CHECKED:
            step = median(later - sooner for sooner, later in pairwise(self._stamps))
            if not 0.5 * self.dt < step < 1.5 * self.dt:
                raise ValueError(
                    f"the time stamps are {step:g} s apart; expected {self.dt:g} s; "
                    "say their unit (--units time=ms) or the rate (--rate)"
                )
