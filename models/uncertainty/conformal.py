"""Bands of any estimator from held-back whole records: split conformal prediction.

    half width = q ℓ(t),    ℓ²(t) = r² + the running mean square of the estimate before t

q is a quantile of |measured − estimate|/ℓ over the samples of records that nothing else saw (Vovk,
Gammerman & Shafer 2005, Sect. 4.2; Papadopoulos et al. 2002 for the scale ℓ). r is the RMS of the
measured output there, so that a band stays open in rest and widens with the motion.

Samples of one record hang together; only the records are exchangeable. So the level of the quantile
is not 95 % but that at which each held-back record has, on average, 95 % of its samples within the
band of the others. It says nothing of one motion alone, nor of motions of another kind.
K records, T samples, n channels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from models.layers.filters import one_pole

LEVEL = 0.95  # of bands, and of intervals of errors
FEWEST = 2  # records: of one alone nobody knows how records differ
PERIODS = 4.0  # mean ones of the motion, that the running mean square remembers
MOST = 20_000  # samples of all records that the quantile is taken of


@dataclass(frozen=True)
class Band:
    """A 95 % band about an estimate.

    factor, floor (n,): q, and r in the unit of the output; memory [s] of the running mean square;
    others: share of the samples of each held-back record within the band of the others.
    """

    factor: Sequence[float]
    floor: Sequence[float]
    memory: float
    others: Sequence[float]

    def __post_init__(self) -> None:
        numbers = (*self.factor, *self.floor, self.memory)
        if len(self.factor) != len(self.floor) or not all(0.0 <= u < math.inf for u in numbers):
            raise ValueError(f"factor={self.factor}, floor={self.floor}, memory={self.memory} s: "
                             "expected numbers of 0 or more for each channel")  # fmt: skip

    def half_widths(self, estimate: Tensor, dt: float) -> Tensor:
        """Half widths (…, T, n), in the unit of the output, about an estimate (…, T, n).

        Raises ValueError for an estimate of another number of channels.
        """
        if estimate.shape[-1] != len(self.factor):
            raise ValueError(
                f"the band is of {len(self.factor)} channels, the estimate has {estimate.shape[-1]}"
            )
        floor = estimate.new_tensor(self.floor)
        return estimate.new_tensor(self.factor) * _level(estimate, dt, floor, self.memory)


def band_from(
    measured: Sequence[Tensor], estimates: Sequence[Tensor], dt: float, skips: Sequence[int]
) -> Band:
    """The band of K held-back records, each measured and estimated (T, n), less its first `skips`.

    Raises ValueError for fewer than FEWEST records, and for estimates that are not finite.
    """
    K = len(measured)
    if K < FEWEST:
        raise ValueError(
            f"a band needs {FEWEST} held-back records at least, there is {K or 'none'}: one alone "
            "does not tell how records differ"
        )
    if not all(torch.isfinite(estimate).all() for estimate in estimates):
        raise ValueError("the estimate of a held-back record is not finite")
    counted = [y[skip:] for y, skip in zip(measured, skips, strict=True)]
    floor = torch.cat(counted).square().mean(dim=0).sqrt()
    floor = floor.clamp_min(torch.finfo(floor.dtype).tiny)
    memory = PERIODS * _period(counted, dt)
    each = min(MOST // K, *map(len, counted))  # of every record, so that all weigh the same
    scores = []
    for y, estimate, skip in zip(measured, estimates, skips, strict=True):
        score = ((y - estimate).abs() / _level(estimate, dt, floor, memory))[skip:]
        scores.append(score[torch.linspace(0, len(score) - 1, each).round().long()])
    together = torch.stack(scores)  # (K, samples, n)
    level, others = _level_of_records(together)
    factor = _quantile(together.reshape(-1, together.shape[-1]).sort(dim=0).values, level)
    return Band(factor.tolist(), floor.tolist(), memory, others.tolist())


def _level(estimate: Tensor, dt: float, floor: Tensor, memory: float) -> Tensor:
    """ℓ (…, T, n); at t it sees the estimate before t alone."""
    at_rest = torch.zeros_like(estimate[..., 0, :])
    square, _ = one_pole(estimate.square(), math.exp(-dt / memory), at_rest)
    return (square + floor.square()).sqrt()


def _period(measured: Sequence[Tensor], dt: float) -> float:
    """The mean period [s]: over the centroid of the power spectra, each channel counting alike."""
    found = []
    for y in measured:
        power = torch.fft.rfft(y - y.mean(dim=0), dim=0).abs().square()
        whole = power.sum(dim=0)
        shares = power / whole.clamp_min(torch.finfo(y.dtype).tiny)
        power = shares.sum(dim=1) / max(1, int((whole > 0.0).sum()))  # of channels that move
        frequency = torch.arange(len(power), dtype=y.dtype) / (len(y) * dt)
        found.append(float((power * frequency).sum()))
    mean, longest = sum(found) / len(found), max(map(len, measured)) * dt
    return longest if mean * longest < 1.0 else 1.0 / mean


def _level_of_records(scores: Tensor) -> tuple[float, Tensor]:
    """Level at which records (K, T, n) lie on average to LEVEL in the band of the others; shares.

    It is 1 where no level does.
    """
    K = len(scores)
    rest = [torch.cat([*scores[:j], *scores[j + 1 :]]).sort(dim=0).values for j in range(K)]

    def shares(level: float) -> Tensor:
        inside = [scores[j] <= _quantile(rest[j], level) for j in range(K)]
        return torch.stack([i.double().mean() for i in inside])

    low, high = 0.5, 1.0
    for _ in range(12):  # to a ten-thousandth of the level
        middle = 0.5 * (low + high)
        low, high = (low, middle) if shares(middle).mean() >= LEVEL else (middle, high)
    return high, shares(high)


def _quantile(ordered: Tensor, level: float) -> Tensor:
    """The smallest of values (m, n), in order, that a given number of them do not exceed."""
    m = len(ordered)
    return ordered[min(max(math.ceil(level * m - 1e-9), 1), m) - 1]
