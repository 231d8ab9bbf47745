"""Weight distance: how far the weights of an adapting estimator have gone from where they were.

D_i² = (w_i − w̄_i)ᵀ S_i⁻¹ (w_i − w̄_i)                                      Mahalanobis (1936)

w_i (P,) are the weights of DOF i, w̄_i and S_i their mean and covariance over sound records. The
weights of an equivalent linear system are its stiffnesses and dampings over a mass, so that a loss
shows in the DOFs that the element joins, and in no other.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.checked import checked
from models.detection.detector import Detector


@checked
class WeightDistance(Detector):
    """Blocks are weights (…, P, n). The estimator's own forgetting is the memory.

    ridge: ≥ 0, added to the correlation matrix of the weights: directions in which they hardly
    ever moved count less than as known exactly.
    """

    def __init__(self, ridge: float = 1e-3, settle: int = 0) -> None:
        super().__init__(settle)
        if not ridge >= 0.0:
            raise ValueError(f"detector.ridge={ridge} must not be negative")
        self.ridge = ridge

    def learn(self, sound: Tensor) -> None:
        weights = sound[:, self.settle :].flatten(0, 1).movedim(-1, 0)  # (n, N, P)
        self.mean = weights.mean(dim=1)
        self.sigma = weights.std(dim=1).clamp_min(1e-300)
        z = (weights - self.mean[:, None]) / self.sigma[:, None]
        correlation = z.mT @ z / (z.shape[1] - 1)
        identity = torch.eye(z.shape[2], dtype=z.dtype)
        self.root = torch.linalg.cholesky(correlation + self.ridge * identity)  # (n, P, P)

    def departure(self, block: Tensor) -> Tensor:
        """L⁻¹ (w − w̄) of each DOF (…, n, P): of unit covariance while the structure is sound."""
        z = (block.movedim(-1, -2) - self.mean) / self.sigma
        return torch.linalg.solve_triangular(self.root, z[..., None], upper=False)[..., 0]

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        return None, torch.linalg.vector_norm(self.departure(block), dim=-1)
