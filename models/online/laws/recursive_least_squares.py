"""Recursive least squares with forgetting, in Potter's square-root form.

min Σ_k λᴺ⁻ᵏ (y_k − φ_kᵀW)² + λᴺ ‖W − W_0‖²/p_0,   P = S Sᵀ = (Σ λᴺ⁻ᵏ φ_k φ_kᵀ + λᴺ/p_0)⁻¹

    f = Sᵀφ,  α = 1/(λ + fᵀf),  K = α S f,  W ← W + K eᵀ,  S ← (S − K fᵀ/(1 + √(λα)))/√λ

Potter (1963), in Bierman, Factorization Methods for Discrete Sequential Estimation (1977), Sect.
II.8; forgetting: Haykin, Adaptive Filter Theory, on recursive least squares.
"""

from __future__ import annotations

from functools import partial
from typing import Annotated, ClassVar

import numpy as np
import torch
from torch import Tensor

from data.annotations import Positive, Range
from data.checked import checked
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import Adapted, Law


@partial(checked, finite=False)  # an infinite limit is none
class RecursiveLeastSquares(Law):
    """The weights that fit the past best, what is older counting less.

    forgetting: λ in (0, 1], a number: a sample counts 1/e after 1/(1 − λ) samples; 1 forgets
    nothing and after N samples is the least-squares fit with a ridge of 1/p0.
    variance: p_0 > 0 [1/φ²], of the weights before the first sample; large says: unknown.
    limit: ≥ 1, times p_0: no weight's variance grows beyond, up to 1/λ for each that is silent.

    Choose it first: it converges in about as many samples as there are weights, at a cost of P² a
    sample. P is positive definite as it is a square, in whatever rounding.

    What makes it unstable: with λ < 1 the variance of a direction that the motion does not excite
    grows as λ⁻ᴺ (wind-up), and the next motion that does excite it throws the weights off. Hence
    the limit: when a variance exceeds it, the least certain weight is measured once, at its present
    value, as exactly as brings its variance back: a Levenberg–Marquardt term (Gunnarsson 1996) for
    one weight at a time, which no weight is moved by. A memory of fewer samples than there are
    independent features is too short whatever the form: the weights follow the noise.
    """

    number: ClassVar[int] = compiled.RECURSIVE_LEAST_SQUARES

    def __init__(
        self,
        forgetting: Annotated[float, Range(0, 1, above=True)] = 1.0,
        variance: Positive = 1e6,
        limit: float = 1.0,
    ) -> None:
        super().__init__()
        if not limit >= 1.0:
            raise ValueError(f"adaptation.limit={limit}: expected at least 1, times the variance")
        self.forgetting, self.variance, self.limit = forgetting, variance, limit

    def start(self, weights: Tensor) -> Adapted:
        square_root = self.variance**0.5 * torch.eye(len(weights)).to(weights)
        return Adapted(weights.detach().clone(), square_root)

    def settings(self) -> np.ndarray:
        return np.array([self.forgetting, self.limit * self.variance])
