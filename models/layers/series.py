"""Double series Σ C_kl T_k(q) T_l(q̇) in a coordinate and its rate, powers or Chebyshev polynomials.

Brewick & Masri (2016), Eqs. 16, 17, 22, 23. Eq. 22 prints 31 terms and says 36; the full set is
used, so that powers and Chebyshev polynomials span the same space.
"""

from __future__ import annotations

import torch
from torch import Tensor


def powers(q: Tensor, order: int) -> Tensor:
    """1, q, q², … (…, order + 1)."""
    return torch.stack([q**k for k in range(order + 1)], dim=-1)


def chebyshev(q: Tensor, order: int) -> Tensor:
    """T_0, T_1, … (…, order + 1) by the recurrence, which holds outside [−1, 1] too."""
    terms = [torch.ones_like(q), q]
    for _ in range(order - 1):
        terms.append(2.0 * q * terms[-1] - terms[-2])
    return torch.stack(terms[: order + 1], dim=-1)


BASES = {"power": powers, "chebyshev": chebyshev}


def double_series(basis: str, order: int, q: Tensor, q_dot: Tensor) -> Tensor:
    """All products T_k(q) T_l(q̇), k, l = 0 … order: (…,) → (…, (order + 1)²)."""
    first, second = BASES[basis](q, order), BASES[basis](q_dot, order)
    return (first[..., :, None] * second[..., None, :]).flatten(-2)
