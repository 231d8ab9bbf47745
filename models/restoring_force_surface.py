"""Restoring-force surface: the force of an element as a double power series of its motion.

r = Σ_i Σ_j C_ij s̄ⁱ ṡ̄ʲ, motions normalised to [−1, 1]           Masri & Caughey (1979)
T samples, one element.
"""

from __future__ import annotations

from collections.abc import Iterable

from torch import Tensor

from data.annotations import Count, NotNegative
from data.record import Drive, Record, Response
from models.element_test import ElementTest
from models.estimator import weight_matrix
from models.layers.least_squares import LeastSquares
from models.layers.scaling import Extents
from models.layers.series import powers, require_order


class RestoringForceSurface(ElementTest):
    """Force (T, 1) from the imposed deformation s and rate ṡ of an element test: no memory.

    order: of the series in each of both; 1 with ridge=0 is a spring, a damper and their product.
    ridge: ≥ 0, without unit, on scaled columns.
    """

    reads = ("f",)

    def __init__(
        self, dofs: int, inputs: int, dt: float, order: Count = 5, ridge: NotNegative = 0.0
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.require_one_element()
        require_order(order, 1, 1)
        self.order, self.ridge = order, ridge
        self.scale = Extents(inputs)
        self.weights = weight_matrix((order + 1) ** 2, 1)

    def terms(self, excitation: Tensor) -> Tensor:
        """s̄ⁱ ṡ̄ʲ (…, T, P) of [s, ṡ] (…, T, 2)."""
        table = powers(self.scale(excitation), self.order)  # (…, T, 2, order + 1)
        return (table[..., 0, :, None] * table[..., 1, None, :]).flatten(-2)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        records = list(batches)
        for record in records:
            self.require_force(record)
        self.scale.fit(r.counted(r.excitation) for r in records)
        fit = LeastSquares(self.ridge)
        for record in records:
            fit.add(record.counted(self.terms(record.excitation)), record.counted(record.a))
        solution = fit.solve()
        self.weights.copy_(solution.weights)
        return solution.facts()

    def forward(self, record: Record) -> Tensor:
        self.require_identified(self.weights)
        return self.terms(record.excitation) @ self.weights

    def free_run(self, drive: Drive) -> Response:
        """Forces as `forward` gives them, for a surface has no state; x and v are those imposed."""
        self.require_identified(self.weights)
        s, rate = drive.u.split(1, dim=-1)
        return Response(s, rate, self.terms(drive.u) @ self.weights)
