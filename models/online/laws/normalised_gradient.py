"""The gradient law of the VWNN literature, normalised: dead zone, leakage and projection.

W ← (1 − γσ) W + γ φ eᵀ/(m + φᵀφ) where ‖e‖ > dead zone,  then ‖w_j‖ ≤ bound

Kosmatopoulos, Smyth, Masri & Chassiakos, J. Appl. Mech. 68 (2001); Ioannou & Sun, Robust Adaptive
Control (1996), Sects. 4.4 and 8.5.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from data.annotations import NotNegative, Positive
from data.checked import checked
from models.online.laws import laws_compiled as compiled
from models.online.laws.law import Law


@checked
class NormalisedGradient(Law):
    """A step along φ that removes the share γ of the present error.

    gain: γ in (0, 2), a number; 1 removes the whole error of the sample where m is 0.
    floor: m ≥ 0 [φ²], keeps small features from large steps.
    dead_zone: ≥ 0 [m/s²]; errors below it are taken for noise and change nothing.
    leakage: σ ≥ 0, a number: weights without excitation fade as (1 − γσ)ᴺ.
    bound: > 0 [m/s² over φ], on the length of each target's weights; None: none.

    Choose it where P² operations a sample are too many: it takes P. The error of one sample goes,
    that of the next comes back: directions die out as the eigenvalues of the features' covariance,
    so with filtered signals, which are all but collinear, it needs hours where recursive least
    squares needs seconds.

    What makes it unstable: γ ≥ 2 overshoots; noise and what the model cannot represent let weights
    drift along directions without excitation, which dead zone, leakage and bound each stop.
    """

    number: ClassVar[int] = compiled.NORMALISED_GRADIENT

    def __init__(
        self,
        gain: Positive = 0.1,
        floor: NotNegative = 1e-3,
        dead_zone: NotNegative = 0.0,
        leakage: NotNegative = 0.0,
        bound: Positive | None = None,
    ) -> None:
        super().__init__()
        self.gain, self.floor, self.dead_zone = gain, floor, dead_zone
        self.leakage, self.bound = leakage, float("inf") if bound is None else bound

    def settings(self) -> np.ndarray:
        return np.array([self.gain, self.floor, self.dead_zone, self.leakage, self.bound])
