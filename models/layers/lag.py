"""First-order lag of a signal that is linear between samples, exact, and without a loop over them.

τ ẏ = u − y,   y[k] = ρ y[k−1] + (g − ρ) u[k−1] + (1 − g) u[k],   ρ = exp(−dt/τ),  g = (1 − ρ) τ/dt
T samples, C channels.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.func import jvp
from torch.nn.functional import pad

FORGOTTEN = 40.0  # lags after which nothing is left of an input, to rounding


def lagged(u: Tensor, lag: Tensor, dt: float) -> Tensor:
    """y (…, T, C) of u (…, T, C) by lags τ (C,) [s], from the steady state under the first sample.

    Differentiable in u and τ.
    """
    reach = FORGOTTEN * float(lag.detach().max()) / dt  # samples
    decay = torch.exp(-dt / lag)
    held = (1.0 - decay) * lag / dt
    later = (held - decay) * u[..., :-1, :] + (1.0 - held) * u[..., 1:, :]
    y = torch.cat([u[..., :1, :], later], dim=-2)
    shift, power = 1, decay
    while shift < min(reach, y.shape[-2]):  # y[k] holds Σ ρʲ of j < 2·shift
        y = y + pad(power * y[..., :-shift, :], (0, 0, shift, 0))
        shift, power = 2 * shift, power * power
    return y


def with_slope(u: Tensor, lag: Tensor, slope: Tensor, dt: float) -> tuple[Tensor, Tensor]:
    """`lagged`, and its derivative (…, T, C) by parameters of which the lags have a slope (C,)."""
    y, by_parameter, *_ = jvp(lambda lag: lagged(u, lag, dt), (lag,), (slope,))
    return y, by_parameter
