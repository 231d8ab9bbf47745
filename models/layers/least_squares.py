"""Linear least squares, rank-revealing, for more samples than fit in memory.

min ‖Φ W − Y‖² by a QR factor that is updated chunk by chunk (so the condition is not squared, as
normal equations do), then the singular values of the small triangle. Columns are scaled to unit
length first: rank and ridge do not depend on units.
N samples, P features, n targets.
Golub & Van Loan, Matrix Computations, Sects. 5.5 and 6.1.
"""

from __future__ import annotations

import math
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
    weights: Tensor  # (P, n)
    rank: int  # independent features
    condition: float  # largest over smallest singular value of the scaled features

    def facts(self) -> dict[str, Any]:
        """Rank and condition."""
        return {"rank": self.rank, "condition": self.condition}


@checked
class LeastSquares:
    """Collects features and targets, then solves. `ridge` ≥ 0 penalises the scaled weights."""

    def __init__(self, ridge: NotNegative = 0.0) -> None:
        self.ridge, self.samples = ridge, 0
        self.triangle: Tensor | None = None  # R of [Φ Y] (P+n, P+n)
        self.features = 0

    def add(self, features: Tensor, targets: Tensor) -> None:
        """Add features (…, N, P) and targets (…, N, n). Raises ValueError for NaN or infinity."""
        phi, y = features.flatten(0, -2), targets.flatten(0, -2)
        if len(phi) != len(y):
            raise ValueError(f"{len(phi)} samples of features, {len(y)} of targets")
        self.features = phi.shape[-1]
        self.samples += len(phi)
        columns = phi.shape[-1] + y.shape[-1]
        block_size = BLOCK if phi.device.type == "cpu" else GPU_BLOCK
        longest = max(TALL * columns, block_size // columns)
        for own, of_own in zip(phi.split(longest), y.split(longest), strict=True):
            above = 0 if self.triangle is None else len(self.triangle)
            block = phi.new_empty(above + len(own), columns)
            if self.triangle is not None:
                block[:above] = self.triangle
            block[above:, : self.features], block[above:, self.features :] = own, of_own
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
        R, Y = self.triangle[:, :P], self.triangle[:, P:]
        length = torch.linalg.vector_norm(R, dim=0, keepdim=True)
        scale = torch.where(length > 0.0, length, 1.0)
        U, sigma, V = torch.linalg.svd(R / scale, full_matrices=False)
        smallest = sigma[0] * torch.finfo(R.dtype).eps * max(self.samples, P)
        rank = int((sigma > smallest).sum())
        known = len(sigma) == P and sigma[-1] > 0.0
        condition = float(sigma[0] / sigma[-1]) if known else math.inf
        if rank < P and self.ridge == 0.0:
            raise RankDeficientError(
                f"rank-deficient features: {rank} of {P} are independent in {self.samples} samples "
                f"(condition {condition:.1e}); give more data, drop a duplicate or silent channel, "
                "or set model.ridge=1e-8"
            )
        gain = sigma / (sigma**2 + self.ridge)
        return Solution((V.mT * gain) @ (U.mT @ Y) / scale.mT, rank, condition)
