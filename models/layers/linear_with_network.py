"""A linear map plus a small network, as a layer and as a step in time.

L [z, w] + W₂ tanh(W₁ [z, w] + b₁) + b₂,   θ = (L, W₁, b₁, W₂, b₂)           Suykens et al. (1995)
T samples, B runs, q states.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

START = 0.01  # of a Glorot start: the network begins as a small addition to the linear map


class LinearWithNetwork(nn.Module):
    """Layer from [z, w] (…, inputs) to outputs, a linear map plus `hidden` neurons."""

    def __init__(self, inputs: int, hidden: int, outputs: int) -> None:
        super().__init__()
        double = torch.float64
        self.linear = nn.Linear(inputs, outputs, bias=False, dtype=double)
        self.inner = nn.Linear(inputs, hidden, dtype=double)
        self.outer = nn.Linear(hidden, outputs, dtype=double)
        self.draw(None)

    @torch.no_grad()
    def draw(self, generator: torch.Generator | None) -> None:
        for layer, size in (self.inner, 1.0), (self.outer, START):
            drawn = torch.empty(layer.weight.shape, dtype=torch.float64)
            layer.weight.copy_(size * nn.init.xavier_uniform_(drawn, generator=generator))
            layer.bias.zero_()

    def theta(self) -> tuple[Tensor, ...]:
        inner, outer = self.inner, self.outer
        return self.linear.weight, inner.weight, inner.bias, outer.weight, outer.bias

    def forward(self, z: Tensor, w: Tensor) -> Tensor:
        return LatentStep()(z, w, *self.theta())


class LatentStep:
    """z[k+1] = L [z, w] + W₂ tanh(W₁ [z, w] + b₁) + b₂, with θ handed in."""

    def __call__(self, z: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        linear, inner, bias, outer, shift = theta
        both = torch.cat([z, w], dim=-1)
        return both @ linear.T + torch.tanh(both @ inner.T + bias) @ outer.T + shift

    def run(self, first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
        """z (T, B, q); the contribution of w is computed for all samples at once."""
        linear, inner, bias, outer, shift = theta
        q = first.shape[-1]
        A, B = linear.T[:q], linear.T[q:]
        W, driven = inner.T[:q], inner.T[q:]
        z, history = first, [first]
        for moved, sum_in in zip(
            (w @ B + shift).unbind(), (w @ driven + bias).unbind(), strict=True
        ):
            z = torch.addmm(torch.addmm(moved, z, A), torch.addmm(sum_in, z, W).tanh(), outer.T)
            history.append(z)
        return torch.stack(history)
