"""Bilinear hysteresis: r = k2 y + (k1 − k2) z + c ẏ, z an elastoplastic slider.

Brewick & Masri (2016), Fig. 5a, Table 1.
"""

from __future__ import annotations

from dataclasses import dataclass

from data.checked import checked
from data.simulation.elements.branches import bits, side, slider_margin, slider_next
from data.simulation.elements.compiling import inlined
from data.simulation.elements.element import Element

BILINEAR = 0


@inlined
def force(p, e, branch, y, ydot, z):  # p = z_y, k1, k2, c1, c2
    yielded = min(branch, 1)  # as a number: a processor guesses jumps badly that change often
    r = p[e, 2] * y + (p[e, 1] - p[e, 2]) * z + p[e, 3 + yielded] * ydot
    return r, (1 - yielded) * ydot


@inlined
def margin(p, e, branch, ydot, z):
    return slider_margin(side(branch), p[e, 0], ydot, z)


@inlined
def next_branch(p, e, branch, ydot, z):
    sliding, z = slider_next(side(branch), p[e, 0], ydot, z)
    return bits(sliding), z


@checked
@dataclass(frozen=True, kw_only=True)
class Bilinear(Element):
    """Bilinear hysteresis: r = k2 y + (k1 − k2) z + c ẏ, z elastoplastic at ±z_y (Fig. 5a)."""

    law = BILINEAR
    fibres = ("stiffness", "post_yield_stiffness")
    yield_displacement: float  # z_y [m]
    stiffness: float  # k1 [N/m]
    post_yield_stiffness: float  # k2 [N/m]
    damping: float = 0.0  # c1 [N s/m], elastic
    post_yield_damping: float = 0.0  # c2 [N s/m], yielded

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "yield_displacement", "stiffness")
        self._require("not negative", "damping", "post_yield_damping")

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping
