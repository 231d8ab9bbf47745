"""First-order low-pass filters as a layer, strictly causal and without a loop over samples.

H(s) = ω_c/(s + ω_c), held input:  y[k] = α y[k−1] + (1 − α) u[k−1],  α = exp(−ω_c dt).

The estimate at t_k must not see the acceleration at t_k. A filter with feedthrough (bilinear
transform, first-order hold, matched) hands it over, hence the u[k−1].
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn.functional import pad


def one_pole(u: Tensor, decay: float, first: Tensor) -> tuple[Tensor, Tensor]:
    """y (…, T, C) of y[k] = α y[k−1] + (1−α) u[k−1] with y[0] = `first` (…, C), and y[T] (…, C).

    Doubling: after a pass with shift d, y[k] holds Σ αʲ w[k−j] over j < 2d, so log₂ T passes do
    (fewer once α^d is below rounding).
    """
    y = torch.cat([first.unsqueeze(-2), (1.0 - decay) * u[..., :-1, :]], dim=-2)
    shift, power = 1, decay
    while shift < y.shape[-2] and power > 1e-30:
        y = y + pad(power * y[..., :-shift, :], (0, 0, shift, 0))
        shift, power = 2 * shift, power * power
    return y, decay * y[..., -1, :] + (1.0 - decay) * u[..., -1, :]


class LowPassCascade(nn.Module):
    """`stages` low-pass filters in series; every stage is an output, so C channels give C·stages.

    `cutoff` ω_c in rad/s, `dt` in s. Raises ValueError for a cutoff outside (0, Nyquist).
    """

    decay: Tensor

    def __init__(self, cutoff: float, stages: int, dt: float) -> None:
        super().__init__()
        nyquist = math.pi / dt
        if not 0.0 < cutoff <= nyquist:
            where = "lies above" if cutoff > nyquist else "must lie between 0 and"
            raise ValueError(
                f"cutoff={cutoff:g} rad/s {where} the Nyquist frequency {nyquist:.0f} rad/s; "
                "change model.cutoff or data.dt"
            )
        if stages < 1:
            raise ValueError(f"stages={stages} must be at least 1")
        self.stages = stages
        self.register_buffer("decay", torch.tensor(math.exp(-cutoff * dt), dtype=torch.float64))

    def forward(self, u: Tensor, state: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """ξ = [H u, H² u, …] (…, T, C·stages) and the state (…, stages, C) to go on from.

        Without a state the filters start at rest.
        """
        decay = float(self.decay)
        if state is None:
            state = u.new_zeros(*u.shape[:-2], self.stages, u.shape[-1])
        outputs, last = [], []
        for stage in range(self.stages):
            u, end = one_pole(u, decay, state[..., stage, :])
            outputs.append(u)
            last.append(end)
        return torch.cat(outputs, dim=-1), torch.stack(last, dim=-2)
