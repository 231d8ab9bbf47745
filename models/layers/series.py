"""Double series Σ C_kl T_k(q) T_l(q̇) in a coordinate and its rate, powers or Chebyshev polynomials.

Brewick & Masri (2016), Eqs. 16, 17, 22, 23. Eq. 22 prints 31 terms and says 36; the full set is
used, so that powers and Chebyshev polynomials span the same space.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from models.layers.least_squares import require_solvable


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


def require_order(order: int, pairs: int, series: int) -> None:
    """Raise ValueError for series of too many pairs of coordinates that no least squares solves."""
    terms = max(pairs * (order + 1) ** 2, series * (order + 1) ** 2)
    require_solvable(terms, f"model.order={order}", "lower model.order")


Term = tuple[int, int, int, int]  # T_k of coordinate a times T_l of coordinate b, as a, k, b, l


def double_series_terms(pairs: Sequence[tuple[int, int]], order: int) -> list[Term]:
    """The different products T_k(q_a) T_l(q_b), k, l = 0 … order, of all pairs (a, b).

    Pairs that share a coordinate share its pure terms, and all share the constant.
    """
    unique: dict[frozenset[tuple[int, int]], Term] = {}
    for a, b in pairs:
        for k in range(order + 1):
            for ell in range(order + 1):
                factors = frozenset((q, power) for q, power in ((a, k), (b, ell)) if power > 0)
                unique.setdefault(factors, (a, k, b, ell))
    return list(unique.values())


def double_series(basis: str, order: int, terms: Sequence[Term], q: Tensor) -> Tensor:
    """Values of the terms: coordinates (…, C) → (…, P)."""
    table = BASES[basis](q, order)  # (…, C, order + 1)
    a, k, b, ell = (list(index) for index in zip(*terms, strict=True))
    return table[..., a, k] * table[..., b, ell]
