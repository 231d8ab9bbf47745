"""What is known of a stream so far: error over the last seconds, overruns, events, alarms.

Overrun: a sample that was done with later than the next one was due.   n DOFs, W samples.
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

TIMED = 1 << 20  # newest samples whose time the percentiles are of


@dataclass(frozen=True)
class Raised:
    """An alarm and the time [s] of the sample that raised it."""

    time: float
    alarm: Alarm


class LiveMonitor:
    """Fed one sample after the other; read by whoever shows or logs it. Nothing in it grows.

    period [s]: from one sample to the next, as they come.
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
        self.kinds: Counter[str] = Counter()  # of events
        self.last_event: Event | None = None
        self.alarms: deque[Raised] = deque(maxlen=100)
        self.first_alarm: Raised | None = None
        self.raised = 0  # alarms

    def saw(self, sample: Sample, estimate: np.ndarray) -> None:
        """A sample and the estimate (n,) that was made of it."""
        row = self.samples % len(self.measured)
        self.samples += 1
        self.time = self.stream.watch.time
        a = math.nan if sample.a is None else sample.a.numpy()
        self.measured[row], self.estimated[row] = a, estimate
        error, size = (self.measured[row] - estimate) ** 2, self.measured[row] ** 2
        if np.isfinite(error).all():
            self.squares[0] += error
            self.squares[1] += size
        self._count_events()

    def took(self, seconds: float, late: float) -> None:
        """What the newest sample took, and how long after it was due it was done with."""
        self.taken[(self.samples - 1) % TIMED] = seconds
        self.overruns += late > self.period

    def alarmed(self, alarm: Alarm) -> Raised:
        raised = Raised(self.time, alarm)
        self.alarms.append(raised)
        self.first_alarm = self.first_alarm or raised
        self.raised += 1
        return raised

    def _count_events(self) -> None:
        events = self.stream.watch.events
        if not events or events[-1] is self.last_event:
            return
        for event in reversed(events):
            if event is self.last_event:
                break
            self.kinds[event.kind] += 1
        self.last_event = events[-1]

    def window(self) -> tuple[np.ndarray, np.ndarray]:
        """Measured and estimated (≤ W, n) [m/s²] over the last WINDOW seconds, oldest first."""
        W = len(self.measured)
        if self.samples < W:
            return self.measured[: self.samples], self.estimated[: self.samples]
        shift = -(self.samples % W)
        return np.roll(self.measured, shift, axis=0), np.roll(self.estimated, shift, axis=0)

    def running_error(self) -> tuple[float, np.ndarray]:
        """Eq. 21 in percent over the last WINDOW seconds, total and of each DOF (n,)."""
        measured, estimated = self.window()
        error, size = (measured - estimated) ** 2, measured**2
        sound = np.isfinite(error).all(axis=1)
        return _percent(error[sound].sum(axis=0), size[sound].sum(axis=0))

    def error(self) -> tuple[float, np.ndarray]:
        """Eq. 21 in percent since the beginning, total and of each DOF (n,)."""
        return _percent(*self.squares)

    def latency(self) -> tuple[float, float]:
        """Median and 99.9th percentile [s] of the time that a sample took."""
        taken = np.frombuffer(self.taken)[: min(self.samples, TIMED)]
        if not len(taken):
            return math.nan, math.nan
        middle, most = np.quantile(taken, [0.5, 0.999])
        return float(middle), float(most)


def _percent(error: np.ndarray, size: np.ndarray) -> tuple[float, np.ndarray]:
    """NaN where nothing moved."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(100.0 * np.sqrt(error.sum() / size.sum())), 100.0 * np.sqrt(error / size)
