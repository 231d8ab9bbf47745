"""The stop operator: a slider in series with a spring, whose stretch is limited.

z_k = min(max(z_{k−1} + s_k − s_{k−1}, −l), l)             Brokate & Sprekels (1996), Sect. 2.2
T samples, J sliders side by side.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from data.numba_cache import compilers

compiled, _ = compilers(Path(__file__))


@compiled
def follow(s, widths, first, z):
    """Fill z (T, J) under a motion s (T,), from `first` (J,), of half widths (J,)."""
    for j in range(widths.size):
        limit, now = widths[j], first[j]
        for k in range(s.size):
            if k > 0:
                now += s[k] - s[k - 1]
            now = min(max(now, -limit), limit)
            z[k, j] = now


def stretches(s: Tensor, widths: Tensor, first: Tensor) -> Tensor:
    """z (T, J) under a motion s (T,), from `first` (J,), of half widths l (J,)."""
    z = torch.zeros(len(s), len(widths), dtype=torch.float64)
    follow(*(u.detach().contiguous().numpy() for u in (s, widths, first)), z.numpy())
    return z


def hats(x: Tensor, nodes: int) -> Tensor:
    """Piecewise linear shapes (…, nodes) on even nodes over [−1, 1], each 1 at its own node.

    Beyond the last nodes they keep their values.
    """
    place = 0.5 * (x.clamp(-1.0, 1.0) + 1.0) * (nodes - 1)
    distance = (place[..., None] - torch.arange(nodes).to(place)).abs()
    return (1.0 - distance).clamp_min(0.0)
