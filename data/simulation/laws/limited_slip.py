"""Limited slip: a slider, and a spring behind a gap. Brewick & Masri (2016), Fig. 5b, Table 1.

The branch keeps the slider's side in bits 0–1 and the gap's in bits 2–3.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import bits, side, slider_margin, slider_next
from data.simulation.laws.candidate import (
    BESIDE,
    DAMPING,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Values,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import LARGEST_DISPLACEMENT, Command, Element, opensees_damper
from data.simulation.laws.polynomial import Polynomial


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = z_y, k1, k2, c1, c2, z_g
    slider, gap = branch & 3, side(branch >> 2)
    spring = 0.0 if gap == 0 else p[2] * (y - gap * p[5])
    if slider == 0:
        return p[1] * z + spring + p[3] * ydot, ydot
    return p[1] * z + spring + p[4] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    slider, gap = side(branch), side(branch >> 2)
    to_gap = p[5] - abs(y) if gap == 0 else gap * y - p[5]
    return min(to_gap, slider_margin(slider, p[0], ydot, z))


@inlined
def next_branch(p, m, branch, y, ydot, z):
    slider, z = slider_next(side(branch), p[0], ydot, z)
    gap = 0.0 if abs(y) < p[5] else y
    return bits(slider) | bits(gap) << 2, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class LimitedSlip(Element):
    """Slider (k1, ±z_y) in parallel with a spring k2 beyond a gap ±z_g, plus c ẏ (Fig. 5b)."""

    fibres = ("stiffness", "gap_stiffness")
    yield_displacement: Positive  # z_y [m]
    stiffness: Positive  # k1 [N/m]
    gap_stiffness: NotNegative  # k2 [N/m]
    damping: NotNegative = 0.0  # c1 [N s/m], sticking
    slip_damping: NotNegative = 0.0  # c2 [N s/m], slipping
    gap: Positive  # z_g [m]

    def opensees(self) -> list[Command]:
        if self.damping != self.slip_damping:
            raise ValueError("LimitedSlip of two dampers is no stock material of OpenSees")
        k = self.gap_stiffness
        springs = [
            ("ElasticPPGap", k, s * LARGEST_DISPLACEMENT * k, s * self.gap, 0.0)
            for s in (1.0, -1.0)
        ]
        slider: Command = ("ElasticPP", self.stiffness, self.yield_displacement)
        return [slider, *(springs if k > 0.0 else []), *opensees_damper(self.damping)]


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    """With one damper, as in all structures of the paper, and a spring beside it."""
    own = {name: value for name, value in values.items() if name != "spring"}
    law = LimitedSlip(between=between, slip_damping=values["damping"], **own)
    return [law, Polynomial(between=between, stiffness=values["spring"])]


CANDIDATES = (
    Candidate(
        "LimitedSlip",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "gap_stiffness": Parameter(0.1, 2.0, lambda units: units.slope, symbol="N/m"),
            "gap": Parameter(0.1, 0.8, lambda units: units.length, symbol="m"),
            "damping": DAMPING,
            "spring": BESIDE,
        },
        _elements,
        number=21,
        yields="yield_displacement",
        sized=("stiffness", "gap_stiffness"),
    ),
)
