"""Maxwell's damper: a spring in series with a dashpot, as a damper on its brace, or rubber.

    r = k z,   ż = ẏ − sgn(r) |r/C|^(1/a)

Slow motions meet the dashpot C sgn(ẏ) |ẏ|ᵃ alone, fast ones the spring k alone; with a = 1 the
force relaxes in C/k. ViscousDamper of OpenSees. State z: elongation of the spring.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from data.annotations import Positive, Range
from data.checked import checked
from data.simulation.laws.branches import margin, next_branch  # noqa: F401  of one branch
from data.simulation.laws.candidate import (
    DAMPING,
    STIFFNESS,
    Candidate,
    Parameter,
    Small,
    Values,
    of_spring,
    share,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element
from data.simulation.laws.polynomial import Polynomial
from data.simulation.laws.power_damper import (
    COEFFICIENT,
    SPRING,
    SPRING_EXPONENT,
    begin_beside_spring,
    power_spring,
)


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = k, C, a
    r = p[0] * z
    if p[2] == 1.0:
        return r, ydot - r / p[1]
    return r, ydot - math.copysign(abs(r / p[1]) ** (1.0 / p[2]), r)


@checked
@dataclass(frozen=True, kw_only=True)
class Maxwell(Element):
    """Spring k in series with a dashpot C sgn(v) |v|ᵃ. Raises ValueError out of range."""

    fibres = ("stiffness", "damping")
    stiffness: Positive  # k [N/m]
    damping: Positive  # C [N (s/m)ᵃ]
    exponent: Annotated[float, Range(0, 1, above=True)] = 1.0  # a

    def weakened(self, kept: float) -> tuple[float, ...]:
        # r/C of what is left is that of every fibre; of none, z relaxes as before
        return (kept * self.stiffness, max(kept, 1e-300) * self.damping, self.exponent)

    def tangent(self) -> tuple[float, float]:
        """Of slow motions: the dashpot; where that is the stiffer the slower, the spring."""
        return (0.0, self.damping) if self.exponent == 1.0 else (self.stiffness, 0.0)

    def opensees(self) -> list[Command]:
        return [("ViscousDamper", self.stiffness, self.damping, self.exponent)]


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    own = {"exponent": values["exponent"]} if "exponent" in values else {}
    series = Maxwell(
        between=between, stiffness=values["stiffness"], damping=values["coefficient"], **own
    )
    damper = Polynomial(between=between, stiffness=0.0, damping=values["damping"])
    return [series, damper, *(power_spring(values, between) if "spring" in values else ())]


def _begin_braced(law: Candidate, small: Small) -> dict[str, float]:
    """Small motions have the spring and the brace in parallel: the dashpot holds, for a < 1."""
    if not small.sure:
        return {}
    beside, brace = small.parts()
    sizes = {"stiffness": brace.spring, "spring": beside.spring, "damping": small.damper}
    return law.numbers(sizes, small.units)


_PARAMETERS = {
    "stiffness": STIFFNESS,
    "coefficient": Parameter(0.1, 1.0, lambda units: units.damping, symbol="N s/m"),
    "damping": DAMPING,
    "spring": SPRING,
}
_BRACED = Candidate(
    "BracedDamper",
    {
        "stiffness": STIFFNESS,
        "coefficient": COEFFICIENT,
        "exponent": share(0.15, 0.9),
        "damping": DAMPING,
        "spring": SPRING,
    },
    _elements,
    number=31,
    paired=True,
    sized=("stiffness", "coefficient"),
    begin=_begin_braced,
)
CANDIDATES = (
    _BRACED,
    *Candidate(
        "Maxwell",
        _PARAMETERS,
        _elements,
        number=18,
        sized=("stiffness", "coefficient"),
        begin=begin_beside_spring,
    ).widened("MaxwellAndSpring", 23, {"spring_exponent": SPRING_EXPONENT}, begin=of_spring),
)
