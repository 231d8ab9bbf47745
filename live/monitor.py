"""Numbers of a stream so far: error over the last seconds, overruns, events, alarms.

Overrun: a sample whose work ended after the next sample was due.   n DOFs, W samples.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter, deque
from dataclasses import dataclass

import numpy as np

from data.sample import Sample
from models.detection.detector import Alarm
from models.online.guard import Event
from models.online.scores import WINDOW
from models.online.stream import Stream

TIMED = 1 << 20  # newest samples, of which the percentiles of the time are taken


@dataclass(frozen=True)
class TimedAlarm:
    """An alarm and the time [s] of the sample that raised it."""

    time: float
    alarm: Alarm


class LiveMonitor:
    """Follows a stream sample by sample, for those who show or log it, in constant memory.

    period [s]: from one sample to the next, at the speed at which samples come.
    """

    def __init__(self, stream: Stream, period: float) -> None:
        n, dt = stream.estimator.dofs, stream.estimator.dt
        self.stream, self.period = stream, period
        W = max(2, round(WINDOW / dt))
        self.measured, self.estimated = np.zeros((W, n)), np.zeros((W, n))
        self.squares = np.zeros((2, n))  # Σ of errors and of measurements, since the beginning
        self.samples, self.overruns = 0, 0
        self.time = 0.0  # [s] of the newest sample
        self.taken = array("d", bytes(8 * TIMED))  # [s], of the newest samples
        self.alarms: deque[TimedAlarm] = deque(maxlen=100)
        self.first_alarm: TimedAlarm | None = None
        self.alarm_count = 0

    def add_sample(self, sample: Sample, estimate: np.ndarray) -> None:
        """Take over a sample and its estimate (n,)."""
        row = self.samples % len(self.measured)
        self.samples += 1
        self.time = self.stream.watch.time
        a = math.nan if sample.a is None else sample.a.numpy()
        self.measured[row], self.estimated[row] = a, estimate
        if self.stream.watch.bad:  # what was refused says nothing about the model
            self.measured[row] = math.nan
        error, size = (self.measured[row] - estimate) ** 2, self.measured[row] ** 2
        if np.isfinite(error).all():
            self.squares[0] += error
            self.squares[1] += size

    def add_time(self, seconds: float, late: float) -> None:
        """Take over how long the newest sample took, and how long after its due time it ended."""
        self.taken[(self.samples - 1) % TIMED] = seconds
        self.overruns += late > self.period

    def add_alarm(self, alarm: Alarm) -> TimedAlarm:
        """Take over an alarm of the newest sample; the alarm with its time."""
        timed = TimedAlarm(self.time, alarm)
        self.alarms.append(timed)
        self.first_alarm = self.first_alarm or timed
        self.alarm_count += 1
        return timed

    @property
    def kinds(self) -> Counter[str]:
        """How many events there were, by kind."""
        return self.stream.watch.kinds

    @property
    def last_event(self) -> Event | None:
        """The newest event, if there was any."""
        events = self.stream.watch.events
        return events[-1] if events else None

    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured and estimated (≤ W, n) [m/s²] over the last WINDOW seconds, oldest first."""
        W = len(self.measured)
        if self.samples < W:
            return self.measured[: self.samples], self.estimated[: self.samples]
        shift = -(self.samples % W)
        return np.roll(self.measured, shift, axis=0), np.roll(self.estimated, shift, axis=0)

    def running_error(self) -> tuple[float, np.ndarray]:
        """Error (Eq. 21) in percent over the last WINDOW seconds, total and of each DOF (n,)."""
        measured, estimated = self.window()
        error, size = (measured - estimated) ** 2, measured**2
        sound = np.isfinite(error).all(axis=1)
        return _percent(error[sound].sum(axis=0), size[sound].sum(axis=0))

    def error(self) -> tuple[float, np.ndarray]:
        """Error (Eq. 21) in percent since the beginning, total and of each DOF (n,)."""
        return _percent(*self.squares)

    def latency(self) -> tuple[float, float]:
        """Median and 99.9th percentile [s] of the time that a sample took."""
        taken = np.frombuffer(self.taken)[: min(self.samples, TIMED)]
        if not len(taken):
            return math.nan, math.nan
        middle, most = np.quantile(taken, [0.5, 0.999])
        return float(middle), float(most)


def _percent(error: np.ndarray, size: np.ndarray) -> tuple[float, np.ndarray]:
    """Errors of sums of squares (n,), total and of each DOF; NaN where nothing moved."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(100.0 * np.sqrt(error.sum() / size.sum())), 100.0 * np.sqrt(error / size)
