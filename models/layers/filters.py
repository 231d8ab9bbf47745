"""First-order low-pass filters as a layer, strictly causal and without a loop over samples.

H(s) = ω_c/(s + ω_c), held input:  y[k] = α y[k−1] + (1 − α) u[k−1],  α = exp(−ω_c dt).

The estimate at t_k must not see the acceleration at t_k. A filter with feedthrough (bilinear
transform, first-order hold, matched) would pass that acceleration on, hence the u[k−1].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from data.annotations import MOST, Range
from data.checked import checked


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


def require_below_nyquist(name: str, cutoff: float, dt: float) -> None:
    """Raise ValueError for a cutoff [rad/s] outside (0, Nyquist)."""
    nyquist = math.pi / dt
    if not 0.0 < cutoff <= nyquist:
        where = "lies above" if cutoff > nyquist else "must lie between 0 and"
        raise ValueError(
            f"{name}={cutoff:g} rad/s {where} the Nyquist frequency {nyquist:.0f} rad/s; "
            f"change model.{name} or data.dt"
        )


@checked
class LowPassCascade(nn.Module):
    """`stages` low-pass filters in series; every stage is an output, so C channels give C·stages.

    `cutoff` ω_c in rad/s, `dt` in s. Raises ValueError for a cutoff outside (0, Nyquist).
    """

    decay: Tensor

    def __init__(self, cutoff: float, stages: Annotated[int, Range(1, MOST)], dt: float) -> None:
        super().__init__()
        require_below_nyquist("cutoff", cutoff, dt)
        self.stages = stages
        self.register_buffer("decay", torch.tensor(math.exp(-cutoff * dt), dtype=torch.float64))

    def step(self, u: Tensor, state: Tensor) -> Tensor:
        """The state (…, stages, C) one sample on: the outputs at k+1 from u[k] (…, C)."""
        decay = float(self.decay)
        inputs = torch.cat([u.unsqueeze(-2), state[..., :-1, :]], dim=-2)
        return decay * state + (1.0 - decay) * inputs

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


class SlowCascades(nn.Module):
    """A slow filter, and the same in series with each of several faster ones: all from one state.

    With p the lowest of `cutoffs` [rad/s] and q the others, the outputs are

        a/(s + p) ≈ v,    a/((s + p)(s + q)) ≈ x for slow q, v/q for fast q,

    pseudo-velocity [m/s] and pseudo-displacements [m] that forget after 1/p seconds. Unlike
    `LowPassCascade` the input is linear between samples, and at k, where a[k] is yet unknown, goes
    on to â[k] = 2a[k−1] − a[k−2]: held values would delay x by half a sample, and a power of a
    delayed displacement cannot be mended by a sum. Strictly causal all the same.

    The state (…, m + 2, C) holds the one-pole filters of all m cutoffs, then a[k−1] and a[k−2];
    the outputs (…, m, C) are `outputs` (m, m + 2) times it.
    """

    decays: Tensor
    outputs: Tensor

    def __init__(self, cutoffs: Sequence[float], dt: float) -> None:
        super().__init__()
        for cutoff in cutoffs:
            require_below_nyquist("cutoffs", cutoff, dt)
        if len(cutoffs) < 2 or any(b <= a for a, b in pairwise(cutoffs)):
            raise ValueError(
                f"model.cutoffs={list(cutoffs)} rad/s: expected at least two, from slow to fast, "
                "none twice"
            )
        poles = torch.tensor(list(cutoffs), dtype=torch.float64)
        decays = torch.exp(-poles * dt)
        held = -torch.expm1(-poles * dt) / poles  # ∫ e^{−pτ} dτ over one sample
        newest = (1.0 - held / dt) / poles  # weight of the input at the sample's end
        oldest = held - newest
        one_pole_sum = (oldest + decays * newest) / (1.0 - decays)  # of the filter's own state
        single = torch.cat([one_pole_sum.diag(), 2.0 * newest[:, None], -newest[:, None]], dim=1)
        pairs = (single[:1] - single[1:]) / (poles[1:] - poles[0])[:, None]  # partial fractions
        self.register_buffer("decays", decays, persistent=False)
        self.register_buffer("outputs", torch.cat([single[:1], pairs]), persistent=False)

    def states(self, a: Tensor) -> Tensor:
        """The state (…, T, m + 2, C) before every sample of a (…, T, C), from rest."""
        rest = torch.zeros_like(a[..., 0, :])
        filtered = [one_pole(a, float(decay), rest)[0] for decay in self.decays]
        past = [pad(a, (0, 0, lag, 0))[..., : a.shape[-2], :] for lag in (1, 2)]
        return torch.stack([*filtered, *past], dim=-2)

    def transition(self) -> tuple[Tensor, Tensor]:
        """A (m + 2, m + 2) and b (m + 2) of state[k+1] = A state[k] + b a[k]."""
        m = len(self.decays)
        A = torch.diag(torch.cat([self.decays, self.decays.new_zeros(2)]))
        A[m + 1, m] = 1.0
        b = torch.cat([1.0 - self.decays, self.decays.new_tensor([1.0, 0.0])])
        return A, b
