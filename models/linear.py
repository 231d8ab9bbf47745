"""Equivalent linear system: the mass, damping and stiffness that fit the motion best.

ẍ = −M⁻¹C ẋ − M⁻¹K x + M⁻¹ f                          Brewick & Masri (2016), Eqs. 7–8
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

import torch
from torch import Tensor

from data.record import Record
from models.estimator import Estimator, weight_matrix
from models.layers.least_squares import LeastSquares


class EquivalentLinear(Estimator):
    """Accelerations as a linear function of velocities, displacements and excitation.

    `ridge` ≥ 0, without unit, penalises weights of scaled columns.
    """

    reads: ClassVar[tuple[str, ...]] = ("x", "v", "f")

    def __init__(self, dofs: int, inputs: int, dt: float, ridge: float = 0.0) -> None:
        super().__init__(dofs, inputs, dt)
        self.ridge = ridge
        self.weights = weight_matrix(2 * dofs + inputs, dofs)  # rows: ẋ, x, f

    def state(self, record: Record) -> Tensor:
        """[ẋ, x, f] (…, T, 2n + m)."""
        self.check(record)
        x, v = record.x, record.v
        assert x is not None
        assert v is not None
        return torch.cat([v, x, record.excitation], dim=-1)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        fit = LeastSquares(self.ridge)
        for record in batches:
            counted = slice(record.warmup, None)
            fit.add(self.state(record)[..., counted, :], record.a[..., counted, :])
        solution = fit.solve()
        self.weights.copy_(solution.weights)
        return {"rank": solution.rank, "condition": solution.condition}

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.weights)
        return self.state(record) @ self.weights

    def matrices(self) -> tuple[Tensor, Tensor, Tensor]:
        """M⁻¹C (n, n) [1/s], M⁻¹K (n, n) [1/s²] and the input matrix (n, m), M⁻¹ for forces."""
        damping, stiffness, inputs = self.weights.T.split(
            [self.dofs, self.dofs, self.inputs], dim=1
        )
        return -damping, -stiffness, inputs
