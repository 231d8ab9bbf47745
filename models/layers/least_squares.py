"""Linear least squares, rank-revealing, for more samples than fit in memory.

min ‖Φ W − Y‖² by a QR factor that is updated chunk by chunk (so the condition is not squared, as
normal equations do), then the singular values of the small triangle. Columns are scaled to unit
length first: rank and ridge do not depend on units.
N samples, P features, n targets.  Golub & Van Loan, Matrix Computations, Sects. 5.5 and 6.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


class RankDeficientError(ValueError):
    """The features do not determine the weights."""


@dataclass(frozen=True)
class Solution:
    weights: Tensor  # (P, n)
    rank: int  # independent features
    condition: float  # largest over smallest singular value of the scaled features


class LeastSquares:
    """Collects features and targets, then solves. `ridge` ≥ 0 penalises the scaled weights."""

    def __init__(self, ridge: float = 0.0) -> None:
        if not 0.0 <= ridge < float("inf"):
            raise ValueError(f"model.ridge={ridge} must not be negative")
        self.ridge, self.samples = ridge, 0
        self.triangle: Tensor | None = None  # R of [Φ Y], (P+n, P+n)
        self.features = 0

    def add(self, features: Tensor, targets: Tensor) -> None:
        """Features (…, N, P) and targets (…, N, n)."""
        phi, y = features.flatten(0, -2), targets.flatten(0, -2)
        if phi.shape[0] != y.shape[0]:
            raise ValueError(f"{phi.shape[0]} samples of features, {y.shape[0]} of targets")
        rows = torch.cat([phi, y], dim=-1)
        if not torch.isfinite(rows).all():
            raise ValueError(
                "the signals hold NaN or infinite values; mend the record before identification"
            )
        self.features = phi.shape[-1]
        self.samples += phi.shape[0]
        if self.triangle is not None:
            rows = torch.cat([self.triangle, rows])
        self.triangle = torch.linalg.qr(rows, mode="r").R

    def solve(self) -> Solution:
        """Weights, rank and condition. Raises RankDeficientError, but not with a ridge."""
        if self.triangle is None:
            raise ValueError("no samples to identify from")
        P = self.features
        R, Y = self.triangle[:, :P], self.triangle[:, P:]
        length = torch.linalg.vector_norm(R, dim=0)
        scale = torch.where(length > 0.0, length, 1.0)
        U, sigma, V = torch.linalg.svd(R / scale, full_matrices=False)
        smallest = float(sigma[0]) * torch.finfo(R.dtype).eps * max(self.samples, P)
        rank = int((sigma > smallest).sum())
        condition = float(sigma[0] / sigma[-1]) if sigma[-1] > 0.0 else float("inf")
        if sigma.numel() < P:
            condition = float("inf")
        if rank < P and self.ridge == 0.0:
            raise RankDeficientError(
                f"rank-deficient features: {rank} of {P} are independent in {self.samples} samples "
                f"(condition {condition:.1e}); give more data, drop a duplicate or silent channel, "
                "or set model.ridge=1e-8"
            )
        gain = sigma / (sigma**2 + self.ridge)
        weights = (V.T * gain) @ (U.T @ Y) / scale[:, None]
        return Solution(weights, rank, condition)
