"""Residual level: the largest residual of a block, in units of its usual size. The baseline.

s_i = max_k |e_i[k]| / σ_i        a control chart (Shewhart 1931) of each DOF's residual e = a − â
"""

from __future__ import annotations

from torch import Tensor

from models.detection.detector import Detector


class ResidualLevel(Detector):
    """Blocks are residuals (…, samples, n). Without memory: a change shows at once or never."""

    def learn(self, sound: Tensor) -> None:
        self.sigma = sound[:, self.settle :].square().mean(dim=(0, 1, 2)).sqrt()  # (n,)

    def step(self, memory: Tensor | None, block: Tensor) -> tuple[Tensor | None, Tensor]:
        return None, (block.abs() / self.sigma).amax(dim=-2)
