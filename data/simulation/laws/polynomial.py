"""Cubic spring and linear damper: r = p1 y + p2 ẏ + p3 y³. Brewick & Masri (2016), Eq. 19."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

from data.annotations import NotNegative
from data.checked import checked
from data.simulation.laws.branches import margin, next_branch  # noqa: F401  of one branch
from data.simulation.laws.candidate import DAMPING, STIFFNESS, Candidate, Parameter, Values
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = p1, p2, p3
    return p[0] * y + p[1] * ydot + p[2] * y**3, 0.0


@checked
@dataclass(frozen=True, kw_only=True)
class Polynomial(Element):
    """Cubic spring and linear damper: r = p1 y + p2 ẏ + p3 y³ (Eq. 19)."""

    by_path = True
    fibres = ("stiffness", "cubic_stiffness")
    stiffness: float  # p1 [N/m]
    damping: NotNegative = 0.0  # p2 [N s/m]
    cubic_stiffness: float = 0.0  # p3 [N/m³], hardening > 0 > softening

    def opensees(self) -> list[Command]:
        cubic = [("ElasticPowerFunc", "-coeff", self.cubic_stiffness, "-exp", 3.0)]
        spring = ("Elastic", self.stiffness, self.damping)
        return [spring, *(cubic if self.cubic_stiffness != 0.0 else [])]


def elements_of(law: type[Element]) -> Callable[[Values, Sequence[str]], list[Element]]:
    """The law by its own parameters, with a spring in parallel where there is one."""
    known = {field.name for field in fields(law)}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        own = {name: value for name, value in values.items() if name in known}
        elements: list[Element] = [law(between=between, **own)]
        if "spring" in values:
            elements.append(Polynomial(between=between, stiffness=values["spring"]))
        return elements

    return made


CUBIC = Parameter(0.1, 2.0, lambda units: units.force / units.length**3, symbol="N/m^3")
CANDIDATES = (  # a storey that stays elastic would show nothing of a law's yielding
    Candidate(
        "Linear", {"stiffness": STIFFNESS, "damping": DAMPING}, elements_of(Polynomial), number=8
    ),
    Candidate(
        "HardeningSpring",
        {"stiffness": STIFFNESS, "damping": DAMPING, "cubic_stiffness": CUBIC},
        elements_of(Polynomial),
        number=24,
        sized=("stiffness", "cubic_stiffness"),
    ),
)
