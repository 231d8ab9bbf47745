"""The alarm of a live run: CUSUM of the residual, calibrated on the run's first seconds.

The threshold is that of one false alarm an hour, by Siegmund's formula for blocks that are
independent and normal (models/detection/cumulative_sum.py). Real blocks are neither, and false
alarms come several times as often (docs/live.md): a threshold with a rate that holds takes sound
records of hours, see models/detection/detector.py.
"""

from __future__ import annotations

import torch
from torch import Tensor

from models.detection.cumulative_sum import CumulativeSum, siegmund
from models.detection.detector import Alarm
from models.detection.monitor import Monitor

BLOCK = 1.0  # [s]
LEARNING = 10.0  # [s] at the start, in which the model learns: no part of the calibration
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
