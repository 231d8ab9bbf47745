"""Numbers of a stream so far: error over the last seconds, overruns, events, alarms.

Overrun: a sample whose work ended after the next sample was due.   n DOFs, W samples.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.sample import Sample
from models.detection import Alarm, CumulativeSum, Monitor, siegmund
from models.fit.trained_range import outside
from models.online.guard import Event
from models.online.guard_compiled import FADE
from models.online.outliers import WINDOW as WINDOW_OF_EVENT
from models.online.scores import LEARNING, WINDOW
from models.online.stream import Stream

TIMED = 1 << 20  # newest samples, of which the percentiles of the time are taken


@dataclass(frozen=True)
class TimedAlarm:
    """An alarm and the time [s] of the sample that raised it."""

    time: float
    alarm: Alarm


class LiveMonitor:
    """Follows a stream sample by sample, for those who show or log it, in constant memory.

    period [s]: from one sample to the next, at the speed at which samples come. trained: the range
    that the model was trained in, as metrics.json has it.
    """

    def __init__(
        self, stream: Stream, period: float, trained: Mapping[str, Any] | None = None
    ) -> None:
        n, dt = stream.estimator.dofs, stream.estimator.dt
        self.stream, self.period, self.trained = stream, period, trained or {}
        self.shown = max(2, round(WINDOW / dt))  # samples of the running error
        W = max(self.shown, FADE + WINDOW_OF_EVENT)  # in which a sample may yet be refused
        self.measured, self.estimated = np.zeros((W, n)), np.zeros((W, n))
        self.numbers = np.full(W, -1)  # of these samples in the stream
        self.driven = np.zeros((W, stream.estimator.inputs))
        self.squares = np.zeros((2, n))  # Σ of errors and of measurements, of the samples before
        self.largest = {"acceleration": np.zeros(n), "excitation": self.driven[0].copy()}  # of them
        self.samples, self.overruns = 0, 0
        self.sound = False  # whether any sample was
        self.replays = 0  # of the stream, as known here
        self.time = 0.0  # [s] of the newest sample
        self.taken = array("d", bytes(8 * TIMED))  # [s], of the newest samples
        self.alarms: deque[TimedAlarm] = deque(maxlen=100)
        self.first_alarm: TimedAlarm | None = None
        self.alarm_count = 0

    def add_sample(self, sample: Sample, estimate: np.ndarray) -> None:
        """Take over a sample and its estimate (n,)."""
        watch, row = self.stream.watch, self.samples % len(self.measured)
        error, size = (self.measured[row] - self.estimated[row]) ** 2, self.measured[row] ** 2
        if np.isfinite(error).all():  # of the sample that gives way to this one
            self.squares[0] += error
            self.squares[1] += size
            self.largest = self._reached(slice(row, row + 1))
        self.samples += 1
        self.time, self.numbers[row] = watch.time, watch.sample
        a = math.nan if sample.a is None else sample.a.numpy()
        self.measured[row], self.estimated[row] = a, estimate
        self.driven[row] = sample.excitation.numpy()
        if watch.bad:  # what was refused says nothing about the model
            self.measured[row] = math.nan
        elif not self.sound:
            self.sound = bool(np.isfinite(a).all())
        if watch.replays != self.replays:
            self.replays = watch.replays
            self._take_back([e.sample for e in watch.events if e.kind == "outlier"])

    def _reached(self, rows: slice) -> dict[str, np.ndarray]:
        """The largest so far, with samples of the buffer of which none was refused."""
        sound = np.isfinite(self.measured[rows]).all(axis=1)
        new = {"acceleration": self.measured[rows][sound], "excitation": self.driven[rows][sound]}
        return {
            k: np.fmax(u, np.abs(new[k]).max(axis=0, initial=0.0)) for k, u in self.largest.items()
        }

    def outside(self) -> list[dict[str, Any]]:
        """Where the motion has left the range that the model was trained in, by largest values.

        Spectra are not followed: an outlier could not be taken back out of an oscillator.
        """
        found = self._reached(slice(None))
        if self.stream.drifts is not None:
            found["deformation"] = self.stream.drifts[2]
        return outside(self.trained, {k: {"largest": u.tolist()} for k, u in found.items()})

    def _take_back(self, refused: list[int]) -> None:
        """Leave out samples that proved outliers, and those after them until this was known.

        They were estimated by a model that is no more.
        """
        late = np.isin(self.numbers, refused) & np.isfinite(self.measured).all(axis=1)
        if late.any():
            self.measured[self.numbers >= self.numbers[late].min()] = math.nan

    def add_time(self, seconds: float, late: float) -> None:
        """Take over how long the newest sample took, and how long after its due time it ended."""
        self.taken[(self.samples - 1) % TIMED] = seconds
        self.overruns += late > self.period

    def add_alarm(self, alarm: Alarm) -> TimedAlarm:
        """Take over an alarm of the newest sample; the alarm with its time."""
        number = self.stream.watch.numbers[alarm.dof - 1]
        timed = TimedAlarm(self.time, replace(alarm, dof=number))
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
        """Measured and estimated (≤ shown, n) [m/s²] over the last WINDOW seconds, oldest first."""
        rows = np.arange(max(self.samples - self.shown, 0), self.samples) % len(self.measured)
        return self.measured[rows], self.estimated[rows]

    def running_error(self) -> tuple[float, np.ndarray]:
        """Error (Eq. 21) in percent over the last WINDOW seconds, total and of each DOF (n,)."""
        return _percent(*_squares(*self.window()))

    def noise_percent(self) -> float | None:
        """Error over the last WINDOW seconds by the noise of the sensors alone; None: not known."""
        if (noise := self.stream.noise) is None:
            return None
        measured = self.window()[0]
        sound = np.isfinite(measured).all(axis=1).sum()
        return _percent(sound * noise**2, np.nansum(measured**2, axis=0))[0]

    def error(self) -> tuple[float, np.ndarray]:
        """Error (Eq. 21) in percent since the beginning, total and of each DOF (n,)."""
        missed, measured = _squares(self.measured, self.estimated)
        return _percent(self.squares[0] + missed, self.squares[1] + measured)

    def latency(self) -> tuple[float, float]:
        """Median and 99.9th percentile [s] of the time that a sample took."""
        taken = np.frombuffer(self.taken)[: min(self.samples, TIMED)]
        if not len(taken):
            return math.nan, math.nan
        middle, most = np.quantile(taken, [0.5, 0.999])
        return float(middle), float(most)


def _squares(measured: np.ndarray, estimated: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Σ (n,) of the squares of errors and of measurements, of the sound ones of samples (W, n)."""
    error = (measured - estimated) ** 2
    sound = np.isfinite(error).all(axis=1)
    return error[sound].sum(axis=0), (measured[sound] ** 2).sum(axis=0)


def _percent(error: np.ndarray, size: np.ndarray) -> tuple[float, np.ndarray]:
    """Errors of sums of squares (n,), total and of each DOF; NaN where nothing moved."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(100.0 * np.sqrt(error.sum() / size.sum())), 100.0 * np.sqrt(error / size)


# The alarm of a live run: CUSUM of the residual, calibrated on the run's first seconds.
#
# The threshold is that of one false alarm an hour, by Siegmund's formula for blocks that are
# independent and normal (models/detection.py). Real blocks are neither, and false
# alarms come several times as often (docs/live.md): a threshold with a rate that holds takes sound
# records of hours: conformal_threshold there.

BLOCK = 1.0  # [s]
FALSE = 3600.0  # [s] from one false alarm to the next
FEWEST = 10  # blocks for a mean and a deviation


class ResidualAlarm:
    """Watches residuals; takes the structure for undamaged during the first `sound` seconds.

    Raises ValueError for a time too short to calibrate in.
    """

    def __init__(self, dofs: int, dt: float, sound: float) -> None:
        least = LEARNING + FEWEST * BLOCK
        if not least <= sound < float("inf"):
            raise ValueError(f"--sound {sound:g} s: expected at least {least:g} s")
        self.every = max(1, round(BLOCK / dt))
        self.skipped, self.wanted = round(LEARNING / dt), round((sound - LEARNING) / BLOCK)
        self.dofs, self.residuals = dofs, list[Tensor]()
        self.monitor: Monitor | None = None
        self.raised = False

    def update(self, residual: Tensor) -> Alarm | None:
        """The alarm after the next residual a − â (n,) [m/s²], once when its level rises over 1."""
        if self.skipped > 0:
            self.skipped -= 1
            return None
        if self.monitor is None:
            self._learn(residual)
            return None
        alarm = self.monitor.step(residual)
        if alarm is not None:
            new, self.raised = not self.raised, True
            return alarm if new else None
        self.raised = self.raised and bool((self.monitor.level > 1.0).any())
        return None

    def level(self) -> Tensor | None:
        """The level of each DOF (n,), above 1 an alarm; None until calibrated."""
        return None if self.monitor is None else self.monitor.level

    def _learn(self, residual: Tensor) -> None:
        from scipy.optimize import brentq  # slow to import

        self.residuals.append(residual)
        if len(self.residuals) < self.wanted * self.every:
            return
        detector = CumulativeSum()
        detector.learn(torch.stack(self.residuals).unflatten(0, (self.wanted, self.every))[None])
        sides = 2 * self.dofs  # each DOF is watched for a rise and for a fall
        blocks = sides * FALSE / BLOCK
        detector.usual = torch.ones(self.dofs, dtype=torch.float64)
        detector.threshold = brentq(lambda h: siegmund(detector.slack, h) - blocks, 0.0, 100.0)
        self.monitor, self.residuals = Monitor(detector, self.every), []
