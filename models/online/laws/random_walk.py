"""Kalman filter for weights on a random walk, in Joseph's form.

W[k] = W[k−1] + noise of covariance Q,   y = φᵀW + noise of variance R

    C ← C + Q,  K = C φ/(φᵀC φ + R),  W ← W + K eᵀ,  C ← (1 − K φᵀ) C (1 − K φᵀ)ᵀ + R K Kᵀ

Bucy & Joseph (1968); Ljung & Söderström, Theory and Practice of Recursive Identification (1983).
"""

from __future__ import annotations

from functools import partial
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from data.annotations import NotNegative, Positive
from data.checked import checked
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import Adapted, Law


@partial(checked, finite=False)  # an infinite limit is none
class RandomWalk(Law):
    """Weights that wander, all by as much a sample; how fast is said, not how much is forgotten.

    walk: Q = walk · 1, ≥ 0 [(m/s²)²/φ²] a sample; 0 takes the weights for constant.
    noise: R > 0 [(m/s²)²], of the measurement and of what the model cannot represent.
    variance: > 0 [(m/s²)²/φ²], C before the first sample.
    limit: ≥ 1, times that variance: a weight that uncertain wanders no further.
    The weights depend on the ratios of the three alone.

    Choose it where noise and drift are known in their units: the gain then follows, and tracking is
    optimal for such a walk. Without excitation C grows by Q a sample, not exponentially as under
    forgetting, and stops at the limit.

    What makes it unstable: a noise far below the true one, or a walk far above: the weights then
    follow the noise. In the short form of the update C loses its definiteness by rounding; Joseph's
    adds squares only, and both halves are kept the same.
    """

    number: ClassVar[int] = compiled.RANDOM_WALK

    def __init__(
        self,
        walk: NotNegative = 1e-6,
        noise: Positive = 1e-2,
        variance: Positive = 1e3,
        limit: float = 1.0,
    ) -> None:
        super().__init__()
        if not limit >= 1.0:
            raise ValueError(f"adaptation.limit={limit}: expected at least 1, times the variance")
        self.walk, self.noise, self.variance, self.limit = walk, noise, variance, limit

    def start(self, weights: Tensor) -> Adapted:
        covariance = self.variance * torch.eye(len(weights)).to(weights)
        return Adapted(weights.detach().clone(), covariance)

    def settings(self) -> np.ndarray:
        return np.array([self.walk, self.noise, self.limit * self.variance])
