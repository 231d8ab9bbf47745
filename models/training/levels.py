"""What samples of a measured motion count by: quiet parts as much as half the level of the whole.

A law that follows the strong motion alone is wrong in every smaller one, where friction sticks and
a frame is stiffer; in the sum of squares of a record the quiet parts hardly count.
B records, T samples, n channels.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn.functional import pad

PERIODS = 4.0  # of the median frequency, over which a level is taken
FULL = 0.5  # of the level of the whole: what is above counts as it is
LEAST = 0.05  # of the level of the whole: what is below counts no more


def weights_of_samples(a: Tensor) -> Tensor:
    """Weights (…, T, 1), 1 or more, of samples of a motion (…, T, n)."""
    size = a.square().sum(dim=-1)  # (…, T)
    whole = size.mean(dim=-1, keepdim=True).sqrt()
    level = _local(size, _width(a)).sqrt().clamp(min=LEAST * whole)
    return (FULL * whole / level).clamp_min(1.0)[..., None]


def median_line(a: Tensor) -> int:
    """The line of the spectrum of motions (…, T, n) below which half of their power lies."""
    power = torch.fft.rfft(a, dim=-2).abs().square()
    power = power.sum(dim=-1).reshape(-1, power.shape[-2]).sum(dim=0).cumsum(dim=0)
    return max(1, int(torch.searchsorted(power, 0.5 * power[-1:])))


def _width(a: Tensor) -> int:
    return min(a.shape[-2], max(1, math.ceil(PERIODS * a.shape[-2] / median_line(a))))


def _local(size: Tensor, width: int) -> Tensor:
    """Mean of the samples about each (…, T), of fewer at the ends."""
    sums = pad(size.cumsum(dim=-1), (1, 0))
    T = size.shape[-1]
    at = torch.arange(T, device=size.device)
    first, last = (at - width // 2).clamp_min(0), (at + width - width // 2).clamp_max(T)
    mean = (sums[..., last] - sums[..., first]) / (last - first)
    return mean.clamp_min(0.0)
