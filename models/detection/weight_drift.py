"""Weight drift: small lasting changes of an adapting estimator's weights, added up.

z_i = L_i⁻¹ (w_i − w̄_i),  S_i = L_i L_iᵀ;   c = ‖g_i + z_i‖,   g_i ← (g_i + z_i) max(0, 1 − κ/c)

The statistic of DOF i is ‖g_i‖: the CUSUM of a vector, of Crosier (1988), *Multivariate
generalizations of cumulative sum quality-control schemes*. It adds up what departs in the same
direction for long, and forgets what comes and goes.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.checked import checked
from models.detection.weight_distance import WeightDistance


@checked
class WeightDrift(WeightDistance):
    """Blocks are weights (…, P, n), best with a short memory of the estimator's own.

    slack: κ ≥ 0, half the distance that is to be found, in units of the weights' spread.
    ridge: as for the distance.
    """

    def __init__(self, slack: float = 1.0, ridge: float = 1e-3, settle: int = 0) -> None:
        super().__init__(ridge, settle)
        if not slack >= 0.0:
            raise ValueError(f"detector.slack={slack} must not be negative")
        self.slack = slack

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor, Tensor]:
        departed = self.departure(block)
        total = departed if memory is None else memory + departed  # (…, n, P)
        size = torch.linalg.vector_norm(total, dim=-1, keepdim=True)
        kept = total * (1.0 - self.slack / size.clamp_min(1e-300)).clamp_min(0.0)
        return kept, torch.linalg.vector_norm(kept, dim=-1)
