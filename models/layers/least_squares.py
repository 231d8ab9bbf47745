"""Linear least squares, rank-revealing, for more samples than fit in memory.

min ‖Φ W − Y‖² by a QR factor that is updated chunk by chunk (so the condition is not squared, as
normal equations do), then the singular values of the small triangle. Columns are scaled to unit
length first: rank and ridge do not depend on units.
N samples, P features, n targets; S fits side by side.
Golub & Van Loan, Matrix Computations, Sects. 5.5 and 6.1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from data.annotations import MOST, NotNegative
from data.checked import checked
from data.memory import require_memory
from data.record import all_finite

CHUNK = 1 << 15  # samples whose features are held in memory at a time
SQUARES = 4  # matrices (P, P) at a time
BLOCK = 1 << 17  # numbers of a fit that are factorised at a time: 1 MiB, which a core has at hand
GPU_BLOCK = 1 << 25  # the same on a GPU, which is slow to begin
TALL = 4  # rows of a block over its columns, at least: the triangle is factorised again with each


class RankDeficientError(ValueError):
    """Raised where the features do not determine the weights."""


def require_solvable(features: int, cause: str, remedy: str) -> None:
    """Raise ValueError for more features P than least squares solves: P² numbers, P² a sample."""
    if features > MOST:
        raise ValueError(
            f"{cause} makes {features} features; least squares solves {MOST}: {remedy}"
        )
    require_memory(SQUARES * 8.0 * features**2, f"{cause}, {features} features,", remedy)


@dataclass(frozen=True)
class Solution:
    weights: Tensor  # (P, n), or (S, P, n)
    ranks: Tensor  # () or (S,): independent features
    conditions: Tensor  # () or (S,): largest over smallest singular value of the scaled features

    @property
    def rank(self) -> int:
        """Lowest rank of all fits."""
        return int(self.ranks.min())

    @property
    def condition(self) -> float:
        """Highest condition of all fits."""
        return float(self.conditions.max())

    def facts(self) -> dict[str, Any]:
        """Rank and condition as numbers, or as lists of S numbers."""
        return {"rank": self.ranks.tolist(), "condition": self.conditions.tolist()}


@checked
class LeastSquares:
    """Collects features and targets, then solves. `ridge` ≥ 0 penalises the scaled weights.

    stacked: the first dimension of features and targets counts S fits, solved side by side.
    """

    def __init__(self, ridge: NotNegative = 0.0, stacked: bool = False) -> None:
        self.ridge, self.samples, self.leading = ridge, 0, int(stacked)
        self.triangle: Tensor | None = None  # R of [Φ Y], (…, P+n, P+n)
        self.features = 0

    def add(self, features: Tensor, targets: Tensor) -> None:
        """Add features (…, N, P) and targets (…, N, n). Raises ValueError for NaN or infinity."""
        phi, y = features.flatten(self.leading, -2), targets.flatten(self.leading, -2)
        if phi.shape[:-1] != y.shape[:-1]:
            raise ValueError(f"{phi.shape[-2]} samples of features, {y.shape[-2]} of targets")
        self.features = phi.shape[-1]
        self.samples += phi.shape[-2]
        columns = phi.shape[-1] + y.shape[-1]
        block_size = BLOCK if phi.device.type == "cpu" else GPU_BLOCK
        longest = max(TALL * columns, block_size // columns)
        for own, of_own in zip(phi.split(longest, dim=-2), y.split(longest, dim=-2), strict=True):
            above = 0 if self.triangle is None else self.triangle.shape[-2]
            block = phi.new_empty(*phi.shape[:-2], above + own.shape[-2], columns)
            if self.triangle is not None:
                block[..., :above, :] = self.triangle
            block[..., above:, : self.features], block[..., above:, self.features :] = own, of_own
            if not all_finite(block):
                raise ValueError(
                    "the signals hold NaN or infinite values; mend the record before identification"
                )
            self.triangle = torch.linalg.qr(block, mode="r").R

    def solve(self) -> Solution:
        """Weights, rank and condition. Raises RankDeficientError, but not with a ridge."""
        if self.triangle is None:
            raise ValueError("no samples to identify from")
        P = self.features
        R, Y = self.triangle[..., :P], self.triangle[..., P:]
        length = torch.linalg.vector_norm(R, dim=-2, keepdim=True)
        scale = torch.where(length > 0.0, length, 1.0)
        U, sigma, V = torch.linalg.svd(R / scale, full_matrices=False)
        smallest = sigma[..., :1] * torch.finfo(R.dtype).eps * max(self.samples, P)
        ranks = (sigma > smallest).sum(dim=-1)
        conditions = torch.where(sigma[..., -1] > 0.0, sigma[..., 0] / sigma[..., -1], torch.inf)
        if sigma.shape[-1] < P:
            conditions = torch.full_like(conditions, torch.inf)
        gain = sigma / (sigma**2 + self.ridge)
        weights = (V.mT * gain[..., None, :]) @ (U.mT @ Y) / scale.mT
        solution = Solution(weights, ranks, conditions)
        if solution.rank < P and self.ridge == 0.0:
            raise RankDeficientError(
                f"rank-deficient features: {solution.rank} of {P} are independent in "
                f"{self.samples} samples (condition {solution.condition:.1e}); give more data, "
                "drop a duplicate or silent channel, or set model.ridge=1e-8"
            )
        return solution
