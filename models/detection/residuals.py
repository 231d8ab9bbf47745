"""Detectors that watch the residuals of an estimator, in blocks (…, samples, n) [m/s²]."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from data.annotations import NotNegative, Whole
from data.checked import checked
from models.detection.detector import Detector


class ResidualLevel(Detector):
    """The largest residual of a block, in units of its usual size. The baseline.

    s_i = max_k |e_i[k]| / σ_i    a control chart (Shewhart 1931) of each DOF's residual e = a − â
    Without memory: a change shows at once or never.
    """

    def learn(self, sound: Tensor) -> None:
        self.sigma = sound[:, self.settle :].square().mean(dim=(0, 1, 2)).sqrt()  # (n,)

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        return None, (block.abs() / self.sigma).amax(dim=-2)


@checked
class CumulativeSum(Detector):
    """CUSUM: small lasting changes of the energy of residuals (…, samples, n), added up.

    z = (ln Σ_k e[k]² − μ) / σ over the samples of a block, per DOF; μ, σ of sound records
    g⁺ ← max(0, g⁺ + z − κ),   g⁻ ← max(0, g⁻ − z − κ),   statistic max(g⁺, g⁻)    Page (1954)

    A loss of stiffness makes the residual of a frozen model grow; of one that extrapolates it may
    make it fall, as the motion gets slower: hence both sides.
    slack: κ ≥ 0, half the change of z that is to be found, in standard deviations. Small: finds
    small changes, late. Large: only large ones, soon.
    """

    def __init__(self, slack: NotNegative = 0.5, settle: Whole = 0) -> None:
        super().__init__(settle)
        self.slack = slack

    def learn(self, sound: Tensor) -> None:
        energy = log_energy(sound)[:, self.settle :]
        self.mean = energy.mean(dim=(0, 1))
        self.sigma = energy.std(dim=(0, 1))

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor, Tensor]:
        return self.add(memory, (log_energy(block) - self.mean) / self.sigma)

    def add(self, memory: Tensor | None, z: Tensor) -> tuple[Tensor, Tensor]:
        """g⁺ and g⁻ (2, …, n), and the larger, after z (…, n)."""
        rise = torch.stack([z, -z]) - self.slack
        sums = (rise if memory is None else memory + rise).clamp_min(0.0)
        return sums, sums.amax(dim=0)


def log_energy(block: Tensor) -> Tensor:
    """ln of the mean square (…, n) of a block (…, samples, n)."""
    return block.square().mean(dim=-2).clamp_min(1e-300).log()


def siegmund(slack: float, level: float) -> float:
    """Mean number of blocks to a false alarm of one side, of independent normal z.

    (exp(2κb) − 2κb − 1)/(2κ²) at a level h, b = h + 1.166 (Siegmund 1985).
    """
    b = level + 1.166
    return (math.exp(2.0 * slack * b) - 2.0 * slack * b - 1.0) / (2.0 * slack**2)
