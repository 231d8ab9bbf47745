"""Estimators whose weights enter linearly, as on-line identification needs.

ẍ̂ = known + [φ_1ᵀW_1, φ_2ᵀW_2, …] mixing        heads j with P_j features and n_j outputs, Σ n_j = n
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator

import torch
from torch import Tensor, nn

from data.record import Record
from data.sample import Sample
from models.estimator import Estimator


def require_linear(estimator: Estimator, what: str, solved: bool = False) -> LinearInWeights:
    """The estimator. Raises ValueError, which begins with `what`, for one of other weights.

    solved: nor may a solver train any of its weights.
    """
    free = solved and any(p.requires_grad for p in estimator.parameters())
    if not isinstance(estimator, LinearInWeights) or free:
        raise ValueError(
            f"{what}, whose weights do not enter linearly; choose a VWNN, an equivalent linear "
            "system or a polynomial method"
        )
    return estimator


class LinearInWeights(Estimator):
    """Base of estimators that are sums of features; an adaptation law can follow their weights.

    A record's features come from the batch path in stretches, a sample's from a memory that is
    carried on; both are the same to rounding.
    """

    @abstractmethod
    def heads(self) -> list[nn.Parameter]:
        """Weights W_j (P_j, n_j) of each head."""

    @abstractmethod
    def features_of(self, record: Record) -> Iterator[tuple[slice, list[Tensor]]]:
        """Features (…, t, P_j) of each head, for stretches of a record and where they lie."""

    @abstractmethod
    def features_at(self, sample: Sample, memory: Tensor) -> list[Tensor]:
        """Features (P_j,) of each head at a sample, whose own acceleration is not read."""

    def at_rest(self) -> Tensor:
        """The memory before the first sample; empty where features have none."""
        return torch.zeros(0, dtype=torch.float64)

    def remember(self, sample: Sample, a: Tensor, memory: Tensor) -> Tensor:
        """The memory after a sample whose acceleration (n,) is now known."""
        return memory

    def prepare(self, batches: Iterable[Record]) -> dict[str, float]:
        """Identify, off line, whatever the features depend on; the heads are not needed."""
        return {}

    def known(self, signals: Record | Sample) -> Tensor | None:
        """The part (…, n) of the estimate that does not depend on the heads."""
        return None

    def mixing(self) -> Tensor | None:
        """Matrix (n, n) from the heads' outputs to accelerations; None where they are the same."""
        return None
