"""Time stamps of live samples → seconds since the first sample."""

from __future__ import annotations

from itertools import pairwise
from math import isfinite
from statistics import median

AGREEING = 3  # stamps in a row that are off alike, then a gap or a new clock is believed
NEAR = 3.5  # steps that a stamp may be ahead without being doubted
PATIENCE = 100  # samples; a stamp no further behind may be that of a sample sent again
LEAP = 3600.0  # [s]; a longer step is a clock set ahead, not a silent sensor
CHECKED = 20  # first steps that are compared with the stated rate


class TimeStamps:
    """Seconds since the first sample; a missing stamp is one step after its predecessor.

    So is a stamp that does not fit, ahead or far behind. Where the stamps after it agree with it,
    it was a gap, and time is theirs; or the sensors' clock was set, by more than LEAP ahead or
    back, and time goes on from its newest value. Stamps that repeat or lie a little behind the
    newest are passed on unchanged, for the stream to report, unless they stay behind. Raises
    ValueError where the first steps differ from dt [s] by half of it.
    """

    def __init__(self, dt: float) -> None:
        self.dt = dt
        self.time = -dt  # [s] of the newest sample
        self.origin: float | None = None  # stamp at time 0
        self.behind = 0
        self.note = ""  # how the newest stamp was changed, "" if it was not
        self._doubted: list[float] = []  # the newest stamps, which agree with one another alone
        self._stamps: list[float] = []  # the first stamps

    def __call__(self, stamp: float | None) -> float:
        """Time [s] of the next sample, whose stamp [s] may be missing."""
        self.note = ""
        if stamp is None or not isfinite(stamp):
            if stamp is not None:
                self.note = "the time stamp is missing; one step after the one before"
            return self._advance(self.time + self.dt)
        if self.origin is None:
            self.origin = stamp - (self.time + self.dt)
        time = stamp - self.origin
        self._check_rate(stamp)
        steps = (time - self.time) / self.dt
        if 0.0 < steps < NEAR:
            self._doubted.clear()
            return self._advance(time)
        if -PATIENCE <= steps <= 0.0 and self.behind < PATIENCE:
            self.behind += 1
            return time
        return self._doubt(stamp, time)

    def _doubt(self, stamp: float, time: float) -> float:
        """Time of a sample whose stamp does not follow from those before."""
        before = self._doubted[-1] if self._doubted else stamp
        if not 0.0 < (stamp - before) / self.dt < NEAR:
            self._doubted.clear()
        self._doubted.append(stamp)
        if self.behind < PATIENCE and len(self._doubted) < AGREEING:
            self.note = f"the time stamp {stamp:g} s does not fit; one step after the one before"
            return self._advance(self.time + self.dt, self.behind)
        self._doubted.clear()
        if self.time < time < self.time + LEAP:
            self.note = f"a gap of {time - self.time:g} s"
            return self._advance(time)
        self.note = f"the clock was set, by {time - self.time:g} s; time continues from there"
        self.origin = stamp - (self.time + self.dt)
        return self._advance(self.time + self.dt)

    def _advance(self, time: float, behind: int = 0) -> float:
        self.time, self.behind = time, behind
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
