"""The high-order neural network's activations: sigmoids and their products.

Brewick & Masri (2016), Sect. 2.1, Eq. 6: h(p) = 2/(1 + e^(−2λp)) − 1 = tanh(λ p).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, combinations_with_replacement
from math import comb
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from data.annotations import Positive
from data.checked import checked
from data.numba_cache import compilers
from models.layers.least_squares import require_solvable

compiled, _ = compilers(Path(__file__))
AT_LARGEST = 0.5  # λ ξ at the largest ξ of a channel, where λ is left open


def _products(channels: int, factors: int, squares: bool) -> int:
    """Number of products of a number of factors."""
    if factors == 1 or not squares:
        return comb(channels, factors)
    return comb(channels + factors - 1, factors)


@compiled
def feature_products(h, factors, phi):
    """Writes φ (T, P) of h (T, C + 1), whose last is 1; factors (P, 3) by channel.

    On the processor in production: `forward` in PyTorch, to the bit.
    """
    for k in range(h.shape[0]):
        for p in range(factors.shape[0]):
            phi[k, p] = h[k, factors[p, 0]] * h[k, factors[p, 1]] * h[k, factors[p, 2]]


@checked
class SigmoidProducts(nn.Module):
    """φ(ξ): tanh(λ ξ_i), and all unique products of 2 … `order` of them.

    `channels` is the width of ξ, `weight` is λ in 1/(unit of ξ); None: one for each channel, which
    `take_sizes` sets. A list of orders takes these alone: [1, 3] is an odd function of ξ, without
    `bias`. `squares` admits repeated factors (h_i², h_i² h_j, …), `bias` a constant.
    """

    weight: Tensor

    def __init__(
        self,
        channels: int,
        weight: Positive | None,
        order: int | Sequence[int] = 2,
        squares: bool = True,
        bias: bool = True,
    ) -> None:
        super().__init__()
        orders = list(range(1, min(order, 4) + 1)) if isinstance(order, int) else list(order)
        if not orders or not set(orders) <= {1, 2, 3} or sorted(set(orders)) != orders:
            raise ValueError(f"model.order={order}: choose 1, 2 or 3, or a list as [1, 3]")
        require_solvable(
            sum(_products(channels, n, squares) for n in orders) + bias,
            f"model.order={order} on {channels} channels",
            "lower model.order or model.stages",
        )
        self.channels, self.orders = channels, orders
        known = [torch.nan] * channels if weight is None else weight
        self.register_buffer("weight", torch.tensor(known, dtype=torch.float64))
        choose = combinations_with_replacement if squares else combinations
        factors = {n: list(choose(range(channels), n)) for n in orders if n > 1}
        self.bias = bias
        self.features = channels * (1 in orders) + sum(map(len, factors.values())) + bias
        for count, products in factors.items():
            index = torch.tensor(products, dtype=torch.int64).reshape(len(products), count)
            self.register_buffer(f"factors_{count}", index.T.contiguous(), persistent=False)

    def take_sizes(self, largest: Tensor) -> None:
        """Set λ where it is open, by the largest |ξ| (channels,) that training has."""
        if self.weight.ndim:
            size = torch.where(largest > 0.0, largest, 1.0)  # a silent channel has no size
            self.weight.copy_(AT_LARGEST / size)

    def weights(self) -> np.ndarray:
        """λ of every channel (channels,)."""
        return np.ascontiguousarray(self.weight.expand(self.channels).cpu().numpy())

    def places(self) -> Tensor:
        """The three factors of every feature, by channel (features, 3); `channels` represents 1."""
        singles = [torch.arange(self.channels).unsqueeze(1)] if 1 in self.orders else []
        constant = [torch.empty(1, 0, dtype=torch.int64)] if self.bias else []
        rows = [*singles, *(factors.T.cpu() for factors in self._factors()), *constant]
        return torch.cat([pad(row, (0, 3 - row.shape[1]), value=self.channels) for row in rows])

    def _factors(self) -> list[Tensor]:
        """Channels (count, products) of the factors of all products, order by order."""
        return [getattr(self, f"factors_{count}") for count in self.orders if count > 1]

    def products_of(self, xi: Tensor) -> Tensor:
        """φ (…, features) of ξ, equal to `forward` to the bit.

        Compiled on the processor, unless derivatives are asked for.
        """
        if xi.device.type != "cpu" or xi.requires_grad:
            return self(xi)
        h = pad(torch.tanh(self.weight * xi), (0, 1), value=1.0)
        phi = h.new_empty(*h.shape[:-1], self.features)
        flat = h.reshape(-1, self.channels + 1).numpy()
        feature_products(flat, self.places().numpy(), phi.view(-1, self.features).numpy())
        return phi

    def forward(self, xi: Tensor) -> Tensor:
        """ξ (…, channels) → φ (…, features): first order, products, bias last."""
        h = torch.tanh(self.weight * xi)
        parts = [h] if 1 in self.orders else []
        for factors in self._factors():
            first, *others = factors.unbind()  # (products,) each
            product = h.index_select(-1, first)
            for factor in others:
                product = product * h.index_select(-1, factor)
            parts.append(product)
        if self.bias:
            parts.append(h.new_ones(*h.shape[:-1], 1))
        return torch.cat(parts, dim=-1)
