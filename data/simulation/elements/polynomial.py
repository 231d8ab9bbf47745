"""Cubic spring and linear damper: r = p1 y + p2 ẏ + p3 y³. Brewick & Masri (2016), Eq. 19."""

from __future__ import annotations

from dataclasses import dataclass

from data.checked import checked
from data.simulation.elements.compiling import inlined
from data.simulation.elements.element import Element

POLYNOMIAL = 2


@inlined
def force(p, e, y, ydot):  # p = p1, p2, p3
    return p[e, 0] * y + p[e, 1] * ydot + p[e, 2] * y**3, 0.0


@checked
@dataclass(frozen=True, kw_only=True)
class Polynomial(Element):
    """Cubic spring and linear damper: r = p1 y + p2 ẏ + p3 y³ (Eq. 19)."""

    law = POLYNOMIAL
    by_path = True
    fibres = ("stiffness", "cubic_stiffness")
    stiffness: float  # p1 [N/m]
    damping: float = 0.0  # p2 [N s/m]
    cubic_stiffness: float = 0.0  # p3 [N/m³], hardening > 0 > softening

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("not negative", "damping")

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping
