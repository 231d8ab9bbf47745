"""Change detectors, and their thresholds for a stated rate of false alarms.

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
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
import torch
from torch import Tensor

from data.annotations import Count, NotNegative, Positive, Range, Whole
from data.checked import checked
from data.record import Record
from data.sample import INPUTS, Sample
from data.simulation.scenario import HIGHEST_ORDER
from models.estimator import Estimator
from models.online.adaptive import Online


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

        rate: α, share of sound records with a false alarm. Raises ValueError for too few records,
        and for DOFs whose statistic is zero or not finite there: no alarm would ever be raised.
        """
        self.learn(learnt)
        usual = self.statistics(learnt).amax(dim=-2).median(dim=0).values
        statistics = self.statistics(held)
        known = (usual > 0.0) & usual.isfinite() & statistics.isfinite().flatten(0, 1).all(dim=0)
        if not known.all():
            dofs = ", ".join(str(i + 1) for i in torch.nonzero(~known).flatten().tolist())
            raise ValueError(
                f"{type(self).__name__}: the statistic of DOF {dofs} is zero or not finite in "
                "undamaged records; leave out silent or broken channels, or lower slack or settle"
            )
        self.usual = usual
        peaks = (statistics / usual).amax(dim=(-2, -1))
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


# Detectors that watch the residuals of an estimator, in blocks (…, samples, n) [m/s²].


class ResidualLevel(Detector):
    """The largest residual of a block, in units of its usual size. The baseline.

    s_i = max_k |e_i[k]| / σ_i    a control chart (Shewhart 1931) of each DOF's residual e = a − â
    Without memory: a change shows at once or never.
    """

    def learn(self, sound: Tensor) -> None:
        self.sigma = sound[:, self.settle :].square().mean(dim=(0, 1, 2)).sqrt()  # (n,)

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        return None, (block.abs() / self.sigma).amax(dim=-2)


@checked
class CumulativeSum(Detector):
    """CUSUM: small lasting changes of the energy of residuals (…, samples, n), added up.

    z = (ln Σ_k e[k]² − μ) / σ over the samples of a block, per DOF; μ, σ of sound records
    g⁺ ← max(0, g⁺ + z − κ),   g⁻ ← max(0, g⁻ − z − κ),   statistic max(g⁺, g⁻)    Page (1954)

    A loss of stiffness makes the residual of a frozen model grow; of one that extrapolates it may
    make it fall, as the motion gets slower: hence both sides.
    slack: κ ≥ 0, half the change of z that is to be found, in standard deviations. Small: finds
    small changes, late. Large: only large ones, soon.
    """

    def __init__(self, slack: NotNegative = 0.5, settle: Whole = 0) -> None:
        super().__init__(settle)
        self.slack = slack

    def learn(self, sound: Tensor) -> None:
        energy = log_energy(sound)[:, self.settle :]
        self.mean = energy.mean(dim=(0, 1))
        self.sigma = energy.std(dim=(0, 1))

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor, Tensor]:
        return self.add(memory, (log_energy(block) - self.mean) / self.sigma)

    def add(self, memory: Tensor | None, z: Tensor) -> tuple[Tensor, Tensor]:
        """g⁺ and g⁻ (2, …, n), and the larger, after z (…, n)."""
        rise = torch.stack([z, -z]) - self.slack
        sums = (rise if memory is None else memory + rise).clamp_min(0.0)
        return sums, sums.amax(dim=0)


def log_energy(block: Tensor) -> Tensor:
    """ln of the mean square (…, n) of a block (…, samples, n)."""
    return block.square().mean(dim=-2).clamp_min(1e-300).log()


def siegmund(slack: float, level: float) -> float:
    """Mean number of blocks to a false alarm of one side, of independent normal z.

    (exp(2κb) − 2κb − 1)/(2κ²) at a level h, b = h + 1.166 (Siegmund 1985).
    """
    b = level + 1.166
    return (math.exp(2.0 * slack * b) - 2.0 * slack * b - 1.0) / (2.0 * slack**2)


# Detectors that watch the weights of an adapting estimator, in blocks (…, P, n).
#
# w_i (P,) are the weights of DOF i, w̄_i and S_i their mean and covariance over sound records. Those
# of an equivalent linear system are its stiffnesses and dampings over a mass, so that a loss shows
# in the DOFs that the element joins, and in no other.


@checked
class WeightDistance(Detector):
    """How far the weights have gone from where they were; the estimator's forgetting is the memory.

    D_i² = (w_i − w̄_i)ᵀ S_i⁻¹ (w_i − w̄_i)                                   Mahalanobis (1936)

    ridge: ≥ 0, added to the correlation matrix of the weights: directions in which they hardly
    ever moved count less than as known exactly.
    """

    watches_weights = True

    def __init__(self, ridge: NotNegative = 1e-3, settle: Whole = 0) -> None:
        super().__init__(settle)
        self.ridge = ridge

    def learn(self, sound: Tensor) -> None:
        weights = sound[:, self.settle :].flatten(0, 1).movedim(-1, 0)  # (n, N, P)
        self.mean = weights.mean(dim=1)
        self.sigma = weights.std(dim=1).clamp_min(1e-300)
        z = (weights - self.mean[:, None]) / self.sigma[:, None]
        correlation = z.mT @ z / (z.shape[1] - 1)
        identity = torch.eye(z.shape[2], dtype=z.dtype)
        self.root = torch.linalg.cholesky(correlation + self.ridge * identity)  # (n, P, P)

    def departure(self, block: Tensor) -> Tensor:
        """L⁻¹ (w − w̄) of each DOF (…, n, P): of unit covariance while the structure is sound."""
        z = (block.movedim(-1, -2) - self.mean) / self.sigma
        return torch.linalg.solve_triangular(self.root, z[..., None], upper=False)[..., 0]

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        return None, torch.linalg.vector_norm(self.departure(block), dim=-1)


@checked
class WeightDrift(WeightDistance):
    """Small lasting changes of the weights, added up; best of an estimator with a short memory.

    z_i = L_i⁻¹ (w_i − w̄_i),  S_i = L_i L_iᵀ;   c = ‖g_i + z_i‖,   g_i ← (g_i + z_i) max(0, 1 − κ/c)

    The statistic of DOF i is ‖g_i‖: the CUSUM of a vector, of Crosier (1988), *Multivariate
    generalizations of cumulative sum quality-control schemes*. It adds up what departs in the same
    direction for long, and forgets what comes and goes.
    slack: κ ≥ 0, half the distance that is to be found, in units of the weights' spread.
    ridge: as for the distance.
    """

    def __init__(
        self, slack: NotNegative = 1.0, ridge: NotNegative = 1e-3, settle: Whole = 0
    ) -> None:
        super().__init__(ridge, settle)
        self.slack = slack

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor, Tensor]:
        departed = self.departure(block)
        total = departed if memory is None else memory + departed  # (…, n, P)
        size = torch.linalg.vector_norm(total, dim=-1, keepdim=True)
        kept = total * (1.0 - self.slack / size.clamp_min(1e-300)).clamp_min(0.0)
        return kept, torch.linalg.vector_norm(kept, dim=-1)


# Blocks of samples for a detector: residuals of an estimator, or weights of an adapting one.
#
# A block holds `every` samples; samples that fill no block at the end of a record are left out.
# K blocks, n DOFs, P weights of each DOF.


@torch.no_grad()
def residual_blocks(estimator: Estimator, records: Sequence[Record], every: int) -> Tensor:
    """Residuals a − â (B, K, every, n) [m/s²] of records of equal length."""
    errors = torch.stack([record.a - estimator(record) for record in records])
    count = _count(errors.shape[1], every)
    return errors[:, : count * every].unflatten(1, (count, every))


@torch.no_grad()
def weight_blocks(online: Online, records: Sequence[Record], every: int) -> Tensor:
    """Weights (B, K, P, n) after every block; every record begins with those of training.

    Raises ValueError where an estimator has several heads, whose weights are of no one DOF.
    """
    if len(online.states()) != 1:
        raise ValueError(
            f"{type(online.estimator).__name__} has {len(online.states())} heads; watch its "
            "residuals, or choose an estimator with one weight matrix, such as online_linear"
        )
    weights_of_records = []
    for record in records:
        count = _count(record.samples, every)
        weights, samples = [], 0
        for estimates, states in online.stretches(record, online.law, online.states(), every):
            samples += len(estimates)
            weights += [states[0].weights] if samples % every == 0 else []
        weights_of_records.append(torch.stack(weights[:count]))
    return torch.stack(weights_of_records)


def _count(samples: int, every: int) -> int:
    if not 1 <= every <= samples:
        raise ValueError(f"a block of {every} samples does not fit a record of {samples} samples")
    return samples // every


# The same high-pass filter on all signals, so that slow drifts do not count as changes.
#
# A linear structure obeys the same equation of motion in signals that are all filtered alike:
# F(M ẍ + C ẋ + K x) = F f (Young 1981). Without the slow part, where hysteretic elements creep, the
# weights of an equivalent linear system are far steadier. Causal: nothing is known of the future.


@checked
class HighPass:
    """Butterworth filter of `order`, cutoff [Hz], for signals sampled every `dt` [s].

    Raises ValueError for a cutoff that is not between 0 and the Nyquist frequency.
    """

    def __init__(
        self, cutoff: float, dt: Positive, order: Annotated[int, Range(1, HIGHEST_ORDER)] = 2
    ) -> None:
        from scipy.signal import butter  # slow to import

        if not 0.0 < cutoff < 0.5 / dt:
            raise ValueError(
                f"cutoff={cutoff} Hz must lie between 0 and the Nyquist frequency {0.5 / dt:g} Hz; "
                "lower it or data.dt"
            )
        self.sos = butter(order, cutoff, "highpass", fs=1.0 / dt, output="sos")
        self.states: dict[str, np.ndarray] = {}

    def record(self, record: Record) -> Record:
        """A record, from rest, filtered as it was measured: what is true is left out."""
        return record.measured().map(self._from_rest)

    def sample(self, sample: Sample) -> Sample:
        """The next sample, going on from those before.

        Missing signals stay missing; a channel that is not finite is NaN, and its filter waits.
        """
        named = {name: getattr(sample, name) for name in ("a", *INPUTS)}
        signals = {name: u for name, u in named.items() if u is not None}
        filtered: dict[str, Any] = {name: self._next(name, u) for name, u in signals.items()}
        return replace(sample, **filtered)

    def _from_rest(self, signal: Tensor) -> Tensor:
        from scipy.signal import sosfilt  # slow to import

        filtered = sosfilt(self.sos, signal.numpy(), axis=-2)
        return torch.from_numpy(np.ascontiguousarray(filtered))

    def _next(self, name: str, signal: Tensor) -> Tensor:
        from scipy.signal import sosfilt  # slow to import

        if name not in self.states:
            self.states[name] = np.zeros((len(self.sos), 2, signal.numel()))
        values, before = signal.numpy(), self.states[name]
        filtered, after = sosfilt(self.sos, values[None, :], axis=0, zi=before)
        bad = ~np.isfinite(values)
        self.states[name] = np.where(bad, before, after)
        return torch.from_numpy(np.where(bad, np.nan, filtered[0]))
