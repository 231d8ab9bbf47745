"""Records in units of a modal network: RMS of inputs and outputs, time by a typical frequency.

A change of the records' units therefore changes nothing.   T samples, m inputs, o outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from data.record import Record
from models.modal.between_samples import interpolated
from models.modal.periods import period_of, steady_mean
from models.modal.problem import Motion
from models.modal.run import Excited

FAINT = 0.1  # of the outputs' RMS: a record with less weighs no more for it
STOPS = (0.5, 0.95)  # of a record: what is held back begins between these
FINEST = 0.25  # of a radian of the fastest mode, in a substep
MOST_SUBSTEPS = 8


@dataclass(frozen=True)
class Signals:
    """One time history: u (T, m), y (T, o), how it begins, whether it is one period."""

    u: np.ndarray
    y: np.ndarray
    dt: float
    hold: str
    unknown: bool
    periodic: bool = False

    @staticmethod
    def of(record: Record) -> list[Signals]:
        """Those of a batch. A record that repeats itself is taken as the mean of its periods."""
        found = []
        T = record.samples
        for u, y in zip(
            record.excitation.reshape(-1, T, record.excitation.shape[-1]).cpu().numpy(),
            record.a.reshape(-1, T, record.dofs).cpu().numpy(),
            strict=True,
        ):
            one = Signals(
                u, y, record.dt, record.hold, record.initial_state != "rest",
                record.initial_state == "periodic",
            )  # fmt: skip
            found.append(one.averaged())
        return found

    def averaged(self) -> Signals:
        """The mean of the periods after the first, where there are some."""
        period = None if self.periodic else period_of(self.u)
        if period is None or len(self.u) // period < 2:
            return self
        mean = steady_mean(self.u, self.y, period)
        if mean is None:
            return self
        return replace(self, u=mean[0], y=mean[1], unknown=True, periodic=True)


@dataclass(frozen=True)
class Scale:
    """Units of a model: of inputs (m,), of outputs (o,) and their means, of time [s]."""

    u: np.ndarray
    y: np.ndarray
    mean: np.ndarray
    time: float

    @staticmethod
    def of(signals: Sequence[Signals]) -> Scale:
        """RMS of the inputs, and of the outputs about their means; frequencies by power."""
        u = np.concatenate([one.u for one in signals])
        y = np.concatenate([one.y for one in signals])
        mean = y.mean(axis=0)
        size = [np.sqrt((s * s).mean(axis=0)) for s in (u, y - mean)]
        size = [np.where(s > 0.0, s, 1.0) for s in size]
        squares, power = 0.0, 0.0
        for one in signals:
            omega = 2.0 * np.pi * np.fft.rfftfreq(len(one.y), one.dt)
            lines = (np.abs(np.fft.rfft((one.y - mean) / size[1], axis=0)) ** 2).sum(axis=1)[1:]
            squares, power = squares + float(omega[1:] ** 2 @ lines), power + float(lines.sum())
        typical = np.sqrt(squares / power) if squares > 0.0 else 1.0 / signals[0].dt
        return Scale(size[0], size[1], mean, 1.0 / float(typical))

    def excited(self, one: Signals, substeps: int, ahead: int | None) -> Excited:
        u = one.u / self.u
        if one.periodic:
            u = np.concatenate([u] * 2)
        fine = interpolated(u, one.hold, substeps, ahead, one.periodic)
        return Excited(np.ascontiguousarray(u), fine, one.dt / self.time)

    def motion(
        self, one: Signals, substeps: int, ahead: int | None, held_back: float = 0.0
    ) -> Motion:
        y = (one.y - self.mean) / self.y
        rms = np.sqrt((y * y).mean(axis=0))
        stop = len(y)
        if held_back:  # by power: a quiet tail shows but one mode
            power = (y * y).sum(axis=1).cumsum()
            place = int(np.searchsorted(power, (1.0 - held_back) * power[-1]))
            first, last = (int(share * len(y)) for share in STOPS)
            stop = max(2, min(max(place, first), last))
        weight = 1.0 / np.sqrt(rms**2 + FAINT**2)
        excited, first = self.excited(one, substeps, ahead), len(y) if one.periodic else 0
        return Motion(excited, y, weight, one.unknown and not one.periodic, stop, first)
