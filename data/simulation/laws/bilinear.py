"""Bilinear hysteresis: r = k2 y + (k1 − k2) z + c ẏ, z an elastoplastic slider.

Brewick & Masri (2016), Fig. 5a, Table 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import bits, side, slider_margin, slider_next
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Candidate, Values, share
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = z_y, k1, k2, c1, c2
    yielded = min(branch, 1)  # as a number: a processor guesses jumps badly that change often
    r = p[2] * y + (p[1] - p[2]) * z + (p[4] if yielded == 1 else p[3]) * ydot
    return r, (1 - yielded) * ydot


@inlined
def margin(p, m, branch, y, ydot, z):
    return slider_margin(side(branch), p[0], ydot, z)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    sliding, z = slider_next(side(branch), p[0], ydot, z)
    return bits(sliding), z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Bilinear(Element):
    """Bilinear hysteresis: r = k2 y + (k1 − k2) z + c ẏ, z elastoplastic at ±z_y (Fig. 5a)."""

    fibres = ("stiffness", "post_yield_stiffness")
    yield_displacement: Positive  # z_y [m]
    stiffness: Positive  # k1 [N/m]
    post_yield_stiffness: float  # k2 [N/m]
    damping: NotNegative = 0.0  # c1 [N s/m], elastic
    post_yield_damping: NotNegative = 0.0  # c2 [N s/m], yielded

    def opensees(self) -> list[Command]:
        k, after = self.stiffness, self.post_yield_stiffness
        if self.damping != self.post_yield_damping or after >= k:
            raise ValueError("Bilinear of two dampers, or that stiffens, is no stock material")
        line: Command = ("Elastic", after, self.damping)
        return [line, ("ElasticPP", k - after, self.yield_displacement)]


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    """With one damper, as in all structures of the paper."""
    own = {name: value for name, value in values.items() if name != "hardening_ratio"}
    own["post_yield_stiffness"] = values["hardening_ratio"] * values["stiffness"]
    return [Bilinear(between=between, post_yield_damping=values["damping"], **own)]


CANDIDATES = (
    Candidate(
        "Bilinear",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "hardening_ratio": share(0.01, 0.4),
            "damping": DAMPING,
        },
        _elements,
        number=20,
        yields="yield_displacement",
    ),
)
