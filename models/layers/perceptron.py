"""Small networks: a perceptron with inputs and outputs in physical units, a linear map plus one.

Brewick & Masri (2016), Sect. 2.3; weights start random (Glorot & Bengio 2010).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from data.annotations import MOST, shown
from data.memory import require_memory
from models.layers.scaling import Extents

DEEPEST = 100  # layers
COPIES = 100  # of the parameters that a solver keeps


def require_trainable_size(name: str, hidden: Sequence[int], sizes: Sequence[int]) -> None:
    """Raise ValueError for layers of such `sizes` that are too many, too wide or too large."""
    if len(hidden) > DEEPEST or any(neurons > MOST for neurons in sizes):
        raise ValueError(
            f"model.{name}={shown(list(hidden))}: {DEEPEST} layers of {MOST} neurons at most"
        )
    count = sum(columns * rows for columns, rows in pairwise(sizes))
    require_memory(8.0 * COPIES * count, f"model.{name}={shown(list(hidden))}", "take fewer")


ACTIVATIONS = {"tanh": nn.Tanh, "sigmoid": nn.Sigmoid, "relu": nn.ReLU, "silu": nn.SiLU}
SLOPES: dict[type[nn.Module], Callable[[Tensor, Tensor], Tensor]] = {  # dh/dz of h(z)
    nn.Tanh: lambda z, h: 1.0 - h * h,
    nn.Sigmoid: lambda z, h: h * (1.0 - h),
    nn.ReLU: lambda z, h: (z > 0.0).to(z),
    nn.SiLU: lambda z, h: torch.sigmoid(z) * (1.0 + z - h),
}


class Perceptron(nn.Module):
    """Layers of `hidden` neurons between inputs and outputs that are scaled to [−1, 1].

    Sigmoidal hidden layers, a linear output layer; weights start random (Glorot & Bengio 2010).
    """

    def __init__(
        self, inputs: int, hidden: Sequence[int], outputs: int, activation: str = "tanh"
    ) -> None:
        super().__init__()
        require_trainable_size("hidden", hidden, [inputs, *hidden, outputs])
        if activation not in ACTIVATIONS or not hidden or min(hidden) < 1:
            raise ValueError(
                f"hidden={list(hidden)}, activation={activation!r}: expected numbers of neurons "
                f"and one of {', '.join(ACTIVATIONS)}"
            )
        sizes = [inputs, *hidden, outputs]
        layers: list[nn.Module] = []
        for columns, rows in pairwise(sizes):
            layer = nn.Linear(columns, rows, dtype=torch.float64)
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
            layers += [layer, ACTIVATIONS[activation]()]
        self.layers = nn.Sequential(*layers[:-1])
        self.input_scale, self.output_scale = Extents(inputs), Extents(outputs)

    def forward(self, u: Tensor) -> Tensor:
        return self.output_scale.inverse(self.layers(self.input_scale(u)))


# A linear map plus a small network, as a layer and as a step in time.
#
# L [z, w] + W₂ tanh(W₁ [z, w] + b₁) + b₂,   θ = (L, W₁, b₁, W₂, b₂)           Suykens et al. (1995)
# T samples, B runs, q states.

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
        return latent_step(z, w, *self.theta())


def latent_step(z: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
    """z[k+1] = L [z, w] + W₂ tanh(W₁ [z, w] + b₁) + b₂, with θ handed in."""
    linear, inner, bias, outer, shift = theta
    both = torch.cat([z, w], dim=-1)
    return both @ linear.T + torch.tanh(both @ inner.T + bias) @ outer.T + shift


def latent_run(first: Tensor, w: Tensor, *theta: Tensor) -> Tensor:
    """z (T, B, q) of such steps; the contribution of w is computed for all samples at once."""
    linear, inner, bias, outer, shift = theta
    q = first.shape[-1]
    A, B = linear.T[:q], linear.T[q:]
    W, driven = inner.T[:q], inner.T[q:]
    z, history = first, [first]
    for moved, sum_in in zip((w @ B + shift).unbind(), (w @ driven + bias).unbind(), strict=True):
        z = torch.addmm(torch.addmm(moved, z, A), torch.addmm(sum_in, z, W).tanh(), outer.T)
        history.append(z)
    return torch.stack(history)
