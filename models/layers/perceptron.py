"""Multilayer perceptron with inputs and outputs in physical units.

Brewick & Masri (2016), Sect. 2.3; weights start random (Glorot & Bengio 2010).
"""

from __future__ import annotations

from collections.abc import Sequence
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
