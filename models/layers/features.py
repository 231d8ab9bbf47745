"""The high-order neural network's activations: sigmoids and their products.

Brewick & Masri (2016), Sect. 2.1, Eq. 6: h(p) = 2/(1 + e^(−2λp)) − 1 = tanh(λ p).
"""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement

import torch
from torch import Tensor, nn


class SigmoidProducts(nn.Module):
    """φ(ξ): tanh(λ ξ_i), and all unique products of 2 … `order` of them.

    `channels` is the width of ξ, `weight` is λ in 1/(unit of ξ). `squares` admits repeated factors
    (h_i², h_i² h_j, …), `bias` a constant.
    """

    weight: Tensor

    def __init__(
        self, channels: int, weight: float, order: int = 2, squares: bool = True, bias: bool = True
    ) -> None:
        super().__init__()
        if not 0.0 < weight < float("inf"):
            raise ValueError(
                f"λ={weight} (model.sigmoid_weight) must be positive; about 0.5 over the largest "
                "measured acceleration or force"
            )
        if order not in (1, 2, 3):
            raise ValueError(f"model.order={order}: choose 1, 2 or 3")
        self.register_buffer("weight", torch.tensor(weight, dtype=torch.float64))
        choose = combinations_with_replacement if squares else combinations
        self.factors = [list(choose(range(channels), count)) for count in range(2, order + 1)]
        self.bias = bias
        self.features = channels + sum(map(len, self.factors)) + bias
        for count, products in enumerate(self.factors, start=2):
            index = torch.tensor(products, dtype=torch.int64).reshape(len(products), count)
            self.register_buffer(f"factors_{count}", index.T.contiguous(), persistent=False)

    def forward(self, xi: Tensor) -> Tensor:
        """ξ (…, channels) → φ (…, features): first order, products, bias last."""
        h = torch.tanh(self.weight * xi)
        parts = [h]
        for count in range(2, len(self.factors) + 2):
            index = getattr(self, f"factors_{count}")  # (count, products)
            product = h[..., index[0]]
            for factor in index[1:]:
                product = product * h[..., factor]
            parts.append(product)
        if self.bias:
            parts.append(torch.ones_like(h[..., :1]))
        return torch.cat(parts, dim=-1)
