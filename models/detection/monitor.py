"""A calibrated detector at work, sample by sample.

monitor = Monitor(detector, every=100)
for sample in samples:
    estimate = stream.step(sample)
    alarm = monitor.step(sample.a - estimate, stream.weights[0])
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.checked import checked
from models.detection.detector import Alarm, Detector
from models.detection.weight_distance import WeightDistance


@checked
class Monitor:
    """Collects samples to blocks of `every` and raises the alarm at the end of a block.

    `level` (n,): the statistic of each DOF after the last block, in units of the threshold. Raises
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
        """The alarm after a sample of this residual (n,) [m/s²], with the weights (P, n) then.

        A residual that is missing or not finite is left out of its block, and a block without any
        residual raises no alarm. For a bad sample that a stream mends, give None.
        """
        self._samples += 1
        if residual is not None and bool(torch.isfinite(residual).all()):
            self._residuals.append(residual)
        if self._samples % self.every:
            return None
        block, self._residuals = self._block(weights), []
        number = self._samples // self.every - 1
        if number < self.detector.settle or block is None:
            return None
        self._memory, statistic = self.detector.step(self._memory, block)
        self.level = self.detector.level(statistic)
        size, dof = self.level.max(dim=-1)
        return Alarm(number, int(dof) + 1, float(size)) if size > 1.0 else None

    def _block(self, weights: Tensor | None) -> Tensor | None:
        """The residuals or the weights that the detector watches; None where there are none."""
        if not isinstance(self.detector, WeightDistance):
            return torch.stack(self._residuals) if self._residuals else None
        if weights is None:
            raise ValueError(f"{type(self.detector).__name__} watches weights; give them too")
        return weights if bool(torch.isfinite(weights).all()) else None
