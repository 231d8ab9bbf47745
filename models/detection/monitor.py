"""A calibrated detector at work, sample by sample.

monitor = Monitor(detector, every=100)
for sample in samples:
    estimate = stream.step(sample)
    alarm = monitor.step(sample.a - estimate, stream.weights[0])
"""

from __future__ import annotations

import torch
from torch import Tensor

from models.detection.detector import Alarm, Detector
from models.detection.weight_distance import WeightDistance


class Monitor:
    """Collects samples to looks of `every` and raises the alarm at the end of a look.

    `level` (n,) is the statistic of each DOF in units of the threshold, as of the last look. Raises
    ValueError where the detector is not calibrated, or where weights are watched and none given.
    """

    def __init__(self, detector: Detector, every: int) -> None:
        if detector.usual is None:
            raise ValueError(f"{type(detector).__name__} is not calibrated yet; call calibrate")
        if every < 1:
            raise ValueError(f"every={every} samples must be at least 1")
        self.detector, self.every = detector, every
        self.level = torch.zeros_like(detector.usual)
        self._memory: Tensor | None = None
        self._residuals: list[Tensor] = []
        self._samples = 0

    def step(self, residual: Tensor | None, weights: Tensor | None = None) -> Alarm | None:
        """After a sample: its residual (n,) [m/s²] and the weights (P, n) that it left behind.

        A residual that is missing or not finite is left out of the look; a look without any is no
        look. Of bad samples that a stream mends, give None.
        """
        self._samples += 1
        if residual is not None and bool(torch.isfinite(residual).all()):
            self._residuals.append(residual)
        if self._samples % self.every:
            return None
        seen, self._residuals = self._seen(weights), []
        look = self._samples // self.every - 1
        if look < self.detector.settle or seen is None:
            return None
        self._memory, statistic = self.detector.step(self._memory, seen)
        self.level = self.detector.level(statistic)
        size, dof = self.level.max(dim=-1)
        return Alarm(look, int(dof) + 1, float(size)) if size > 1.0 else None

    def _seen(self, weights: Tensor | None) -> Tensor | None:
        """What the detector looks at, or None."""
        if not isinstance(self.detector, WeightDistance):
            return torch.stack(self._residuals) if self._residuals else None
        if weights is None:
            raise ValueError(f"{type(self.detector).__name__} watches weights; give them too")
        return weights if bool(torch.isfinite(weights).all()) else None
