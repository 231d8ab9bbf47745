"""Scaling of signals to [−1, 1] by their extents in training.  Brewick & Masri (2016), Eq. 23."""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor, nn


class Extents(nn.Module):
    """u' = (u − centre)/reach with the middle and half range of each channel of shape `shape`.

    Unseen motion may exceed ±1. A channel that is constant in training keeps its unit.
    """

    centre: Tensor
    reach: Tensor

    def __init__(self, *shape: int) -> None:
        super().__init__()
        self.register_buffer("centre", torch.zeros(shape, dtype=torch.float64))
        self.register_buffer("reach", torch.ones(shape, dtype=torch.float64))

    def fit(self, signals: Iterable[Tensor]) -> None:
        """Take the extents of signals (…, *shape), handed out in any number of pieces."""
        lead = self.centre.ndim
        flat = [u.reshape(u.shape[: u.ndim - lead].numel(), *self.centre.shape) for u in signals]
        low = torch.stack([u.amin(dim=0) for u in flat]).amin(dim=0)
        high = torch.stack([u.amax(dim=0) for u in flat]).amax(dim=0)
        self.centre.copy_(0.5 * (high + low))
        half = 0.5 * (high - low)
        self.reach.copy_(torch.where(half > 0.0, half, 1.0))

    def forward(self, u: Tensor) -> Tensor:
        return (u - self.centre) / self.reach

    def inverse(self, scaled: Tensor) -> Tensor:
        return self.centre + self.reach * scaled
