"""Detectors that watch the weights of an adapting estimator, in blocks (…, P, n).

w_i (P,) are the weights of DOF i, w̄_i and S_i their mean and covariance over sound records. The
weights of an equivalent linear system are its stiffnesses and dampings over a mass, so that a loss
shows in the DOFs that the element joins, and in no other.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.annotations import NotNegative, Whole
from data.checked import checked
from models.detection.detector import Detector


@checked
class WeightDistance(Detector):
    """How far the weights have gone from where they were; the estimator's forgetting is the memory.

    D_i² = (w_i − w̄_i)ᵀ S_i⁻¹ (w_i − w̄_i)                                   Mahalanobis (1936)

    ridge: ≥ 0, added to the correlation matrix of the weights: directions in which they hardly
    ever moved count less than as known exactly.
    """

    watches_weights = True

    def __init__(self, ridge: NotNegative = 1e-3, settle: Whole = 0) -> None:
        super().__init__(settle)
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


@checked
class WeightDrift(WeightDistance):
    """Small lasting changes of the weights, added up; best of an estimator with a short memory.

    z_i = L_i⁻¹ (w_i − w̄_i),  S_i = L_i L_iᵀ;   c = ‖g_i + z_i‖,   g_i ← (g_i + z_i) max(0, 1 − κ/c)

    The statistic of DOF i is ‖g_i‖: the CUSUM of a vector, of Crosier (1988), *Multivariate
    generalizations of cumulative sum quality-control schemes*. It adds up what departs in the same
    direction for long, and forgets what comes and goes.
    slack: κ ≥ 0, half the distance that is to be found, in units of the weights' spread.
    ridge: as for the distance.
    """

    def __init__(
        self, slack: NotNegative = 1.0, ridge: NotNegative = 1e-3, settle: Whole = 0
    ) -> None:
        super().__init__(ridge, settle)
        self.slack = slack

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor, Tensor]:
        departed = self.departure(block)
        total = departed if memory is None else memory + departed  # (…, n, P)
        size = torch.linalg.vector_norm(total, dim=-1, keepdim=True)
        kept = total * (1.0 - self.slack / size.clamp_min(1e-300)).clamp_min(0.0)
        return kept, torch.linalg.vector_norm(kept, dim=-1)
