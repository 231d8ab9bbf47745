"""Fluid viscous damper beside a spring, whose forces go with powers of the rate and deformation.

    r = C sgn(ẏ) |ẏ|ᵃ + k sgn(y) |y|ᵖ,   below a rate v₀ linear: C ẏ (ẏ² + v₀²)^((a−1)/2)

With a < 1 no fluid is stiffer the slower it flows: seals leak, and nothing could be integrated.
Constantinou & Symans (1993), Struct. Des. Tall Build. 2, 93–132; Viscous of OpenSees, v₀ = 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import margin, next_branch  # noqa: F401  of one branch
from data.simulation.laws.candidate import Candidate, Parameter, Small, Values, of_spring
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = C, a, k, p, v0
    spring = p[2] * math.copysign(abs(y) ** p[3], y)
    return spring + p[0] * ydot * (ydot * ydot + p[4] * p[4]) ** (0.5 * (p[1] - 1.0)), 0.0


@checked
@dataclass(frozen=True, kw_only=True)
class PowerDamper(Element):
    """Fluid damper C sgn(ẏ) |ẏ|ᵃ and spring k sgn(y) |y|ᵖ. Raises ValueError out of range."""

    by_path = True
    fibres = ("damping", "stiffness")
    damping: NotNegative  # C [N (s/m)ᵃ]
    exponent: Positive = 1.0  # a
    stiffness: NotNegative = 0.0  # k [N/mᵖ]
    spring_exponent: Positive = 1.0  # p
    linear_below: Positive = 1e-4  # v₀ [m/s]

    def tangent(self) -> tuple[float, float]:
        """Of a spring with p ≠ 1 there is none: it is next to nothing, or stiff without end."""
        spring = self.stiffness if self.spring_exponent == 1.0 else 0.0
        return spring, self.damping * self.linear_below ** (self.exponent - 1.0)

    def opensees(self) -> list[Command]:
        spring = ("ElasticPowerFunc", "-coeff", self.stiffness, "-exp", self.spring_exponent)
        damper: Command = ("Viscous", self.damping, self.exponent)
        parts = [(damper, self.damping), (spring, self.stiffness)]
        return [command for command, size in parts if size > 0.0]


COEFFICIENT = Parameter(
    0.1,
    1.0,
    lambda units: units.damping,
    symbol="N (s/m)^exponent",
    power=("exponent", lambda units: units.rate),
)
SPRING = Parameter(
    0.02,
    0.5,
    lambda units: units.force / units.length,
    symbol="N/m",
    word="parallel_stiffness",
    power=("spring_exponent", lambda units: units.length),
)
SPRING_EXPONENT = Parameter(0.7, 2.0)


def power_spring(values: Values, between: Sequence[str]) -> list[Element]:
    """The spring beside a dashpot."""
    exponent = values.get("spring_exponent", 1.0)
    spring = {"stiffness": values["spring"], "spring_exponent": exponent}
    return [PowerDamper(between=between, damping=0.0, **spring)]


def begin_beside_spring(law: Candidate, small: Small) -> dict[str, float]:
    """The spring beside a dashpot is that of small motions."""
    return law.numbers({"spring": small.spring}, small.units) if small.sure else {}


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    damper = PowerDamper(
        between=between, damping=values["coefficient"], exponent=values["exponent"]
    )
    return [damper, *power_spring(values, between)]


_PARAMETERS = {
    "exponent": Parameter(0.15, 2.0),
    "coefficient": COEFFICIENT,
    "spring": SPRING,
}
CANDIDATES = Candidate(
    "PowerDamper",
    _PARAMETERS,
    _elements,
    number=17,
    sized=("coefficient",),
    begin=begin_beside_spring,
).widened("PowerDamperAndSpring", 22, {"spring_exponent": SPRING_EXPONENT}, begin=of_spring)
