"""Files of a live run: every estimate as a line of CSV, scalars for TensorBoard.

A line is written at once, so that an interrupted run keeps its lines.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from data.sample import Sample
from live.alarm import ResidualAlarm
from live.monitor import LiveMonitor, TimedAlarm

SCALARS = 20.0  # a second: measured and estimated acceleration


class EstimatesFile:
    """Columns time [s], a1 …, estimate1 … [m/s²], alarm (a DOF, mostly empty). NaN: not measured.

    A file without an estimate does not stay. Raises OSError where the file exists, unless `force`.
    """

    def __init__(self, path: Path, dofs: int, force: bool = False) -> None:
        self.path, self.written = path, False
        self.file = path.open("w" if force else "x", encoding="utf-8", buffering=1)
        numbers = range(1, dofs + 1)
        heads = ["time", *(f"a{i}" for i in numbers), *(f"estimate{i}" for i in numbers), "alarm"]
        self.file.write(",".join(heads) + "\n")

    def write(
        self, time: float, sample: Sample, estimate: np.ndarray, raised: TimedAlarm | None
    ) -> None:
        """Append the line of a sample."""
        a = np.full_like(estimate, np.nan) if sample.a is None else sample.a.numpy()
        values = [round(time, 9), *a.tolist(), *estimate.tolist()]
        dof = "" if raised is None else str(raised.alarm.dof)
        self.file.write(",".join(map(repr, values)) + f",{dof}\n")
        self.written = True

    def close(self) -> None:
        self.file.close()
        if not self.written:
            self.path.unlink()


class Scalars:
    """Measured and estimated accelerations, running error, norm of the weights, alarm level."""

    def __init__(self, folder: Path, monitor: LiveMonitor, alarm: ResidualAlarm | None) -> None:
        from torch.utils.tensorboard import SummaryWriter  # slow to import, seldom needed

        self.writer: Any = SummaryWriter(str(folder), max_queue=1000, flush_secs=1)
        self.monitor, self.alarm = monitor, alarm
        self.next_signals = self.next_rest = 0.0  # [s]

    def write(
        self, time: float, sample: Sample, estimate: np.ndarray, raised: TimedAlarm | None
    ) -> None:
        """Add the scalars of a sample that are due."""
        step, add = self.monitor.stream.watch.sample, self.writer.add_scalar
        if raised is not None:
            add("alarm/dof", raised.alarm.dof, step)
        if time < self.next_signals:
            return
        self.next_signals = time + 1.0 / SCALARS
        for i, value in enumerate(estimate.tolist(), start=1):
            if sample.a is not None:
                add(f"a{i}/measured", float(sample.a[i - 1]), step)
            add(f"a{i}/estimated", value, step)
        if time < self.next_rest:
            return
        self.next_rest = time + 1.0
        add("error/running_percent", self.monitor.running_error()[0], step)
        weights = torch.cat([w.flatten() for w in self.monitor.stream.weights])
        add("weights/norm", float(torch.linalg.vector_norm(weights)), step)
        level = None if self.alarm is None else self.alarm.level()
        for i, value in enumerate([] if level is None else level.tolist(), start=1):
            add(f"alarm/level{i}", value, step)

    def close(self) -> None:
        self.writer.close()
