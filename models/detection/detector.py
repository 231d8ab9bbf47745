"""What a change detector is, and how its threshold is set for a stated rate of false alarms.

A detector takes a block of samples at a time and gives every DOF a statistic, which grows as the
structure departs from sound records. The alarm is raised where the largest statistic, in units of
its usual peak, exceeds one threshold. A statistic depends on no later sample.

Threshold: the j-th smallest peak of m further sound records, j = ⌈(m + 1)(1 − α)⌉. One more sound
record exceeds it with probability at most α, whatever the distribution of peaks (Vovk, Gammerman &
Shafer 2005, conformal prediction, Sect. 2.2): records need only be exchangeable, that is, of the
same kind.    B records, K blocks, n DOFs.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor

from data.annotations import Count, Whole
from data.checked import checked


@dataclass(frozen=True)
class Alarm:
    """When an alarm was raised, and where it points to."""

    block: int  # counted from 0
    dof: int  # 1 … n, of the largest statistic
    size: float  # the largest statistic in units of the threshold, above 1


@checked
class Detector(ABC):
    """Base of all detectors. The first `settle` blocks of a record are not watched."""

    watches_weights = False  # of an adapting estimator, in place of residuals

    def __init__(self, settle: Whole = 0) -> None:
        self.settle = settle
        self.usual: Tensor | None = None  # median peak of each DOF's statistic (n,)
        self.threshold = math.inf

    @abstractmethod
    def learn(self, sound: Tensor) -> None:
        """Take the usual size of the blocks (B, K, ·, n) of sound records."""

    @abstractmethod
    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        """Memory and statistic (…, n) after a block (…, ·, n); the memory before the first is None.

        A block holds residuals (…, samples, n) or weights (…, P, n).
        """

    def statistics(self, blocks: Tensor) -> Tensor:
        """Statistic (…, K, n) of every block (…, K, ·, n), zero before `settle`."""
        memory, statistics = None, []
        for k, block in enumerate(blocks.unbind(dim=-3)):
            if k < self.settle:
                statistics.append(torch.zeros_like(block[..., 0, :]))
                continue
            memory, statistic = self.step(memory, block)
            statistics.append(statistic)
        return torch.stack(statistics, dim=-2)

    def calibrate(self, learnt: Tensor, held: Tensor, rate: float) -> None:
        """Learn from some sound records (B, K, ·, n) and set the threshold on others, `held`.

        rate: α, share of sound records with a false alarm. Raises ValueError for too few records.
        """
        self.learn(learnt)
        self.usual = self.statistics(learnt).amax(dim=-2).median(dim=0).values
        peaks = (self.statistics(held) / self.usual).amax(dim=(-2, -1))
        self.threshold = conformal_threshold(peaks, rate)

    def level(self, statistic: Tensor) -> Tensor:
        """Statistics (…, n) in units of the threshold: above 1 is an alarm."""
        return statistic / self._calibrated() / self.threshold

    def levels(self, blocks: Tensor) -> Tensor:
        """The level (…, K, n) after every block (…, K, ·, n)."""
        self._calibrated()
        return self.level(self.statistics(blocks))

    def alarm(self, blocks: Tensor) -> Alarm | None:
        """The first alarm of one record (K, ·, n), or None."""
        return first_alarm(self.levels(blocks))

    def _calibrated(self) -> Tensor:
        if self.usual is None:
            raise ValueError(f"{type(self).__name__} is not calibrated yet; call calibrate first")
        return self.usual


def first_alarm(levels: Tensor, start: int = 0) -> Alarm | None:
    """The first alarm of levels (K, n) from block `start` on, or None."""
    beyond = torch.nonzero((levels[start:] > 1.0).any(dim=-1))
    if len(beyond) == 0:
        return None
    block = start + int(beyond[0])
    size, dof = levels[block].max(dim=-1)
    return Alarm(block, int(dof) + 1, float(size))


def conformal_threshold(peaks: Tensor, rate: float) -> float:
    """The j-th smallest of m peaks (m,). Raises ValueError where they are too few for the rate."""
    return float(peaks.sort().values[conformal_rank(len(peaks), rate) - 1])


def conformal_rank(m: int, rate: float) -> int:
    """j = ⌈(m + 1)(1 − rate)⌉, in 1 … m. Raises ValueError where it would be m + 1."""
    if not 0.0 < rate < 1.0:
        raise ValueError(f"rate={rate} of false alarms must lie between 0 and 1, per record")
    j = math.ceil((m + 1) * (1.0 - rate) - 1e-9)
    if j > m:
        raise ValueError(
            f"{m} sound records cannot set a threshold for {rate:g} false alarms per record; "
            f"at least {math.ceil(1.0 / rate - 1e-9) - 1} are needed"
        )
    return j


@checked
class Monitor:
    """A calibrated detector at work, sample by sample.

    monitor = Monitor(detector, every=100)
    for sample in samples:
        estimate = stream.step(sample)
        alarm = monitor.step(sample.a - estimate, stream.weights[0])

    Collects samples to blocks of `every` and raises the alarm at the end of a block.
    `level` (n,): the statistic of each DOF after the last block, in units of the threshold. Raises
    ValueError where the detector is not calibrated, or where weights are watched and none given.
    """

    def __init__(self, detector: Detector, every: Count) -> None:
        if detector.usual is None:
            raise ValueError(f"{type(detector).__name__} is not calibrated yet; call calibrate")
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
        if not self.detector.watches_weights:
            return torch.stack(self._residuals) if self._residuals else None
        if weights is None:
            raise ValueError(f"{type(self.detector).__name__} watches weights; give them too")
        return weights if bool(torch.isfinite(weights).all()) else None
