"""State-variable filters: a motion's displacement and velocity, filtered, from its acceleration.

All terms of a linear equation of motion may be filtered alike. With F = s²/(s + ω₀)² the filtered
displacement is a/(s + ω₀)², which needs no integration that drifts.   Young (1981), Automatica 17
T samples, C channels.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

SHARE = 0.3  # of the median frequency of the motion


def corner_frequency(a: Tensor, dt: float) -> float:
    """Corner ω₀ [rad/s]: a share of the median frequency of the power of a (T, C)."""
    power = (torch.fft.rfft(a, dim=0).abs() ** 2).sum(dim=1).cumsum(dim=0)
    median = max(1, int(torch.searchsorted(power, 0.5 * power[-1:])))
    return SHARE * 2.0 * np.pi * median / (dt * a.shape[0])


def state_variables(a: Tensor, corner: float, dt: float) -> tuple[Tensor, Tensor, Tensor]:
    """Filtered displacement, velocity and acceleration (T, C) of a motion that begins at rest.

    The filters are those of the trapezoidal rule.
    """
    from scipy.signal import lfilter  # slow to import

    rise, decay = [dt, dt], [2.0 + corner * dt, corner * dt - 2.0]
    signal = a.cpu().numpy()
    once = lfilter(rise, decay, signal, axis=0)
    twice = lfilter(rise, decay, once, axis=0)
    filtered = (twice, once - corner * twice, signal - 2.0 * corner * once + corner**2 * twice)
    x, v, rest = (torch.from_numpy(np.ascontiguousarray(s)).to(a.device) for s in filtered)
    return x, v, rest
