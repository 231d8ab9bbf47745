"""Metal that hardens on both sides at once and towards the side of its slip, each up to a limit.

ρ = r/k is a length, u the plastic slip, p its sum without sign. Elastic, ρ = y − u, while

    |ρ − α| ≤ y_y + h (1 − exp(−b p))/b;   then   dα = C du − γ α dp

The yield limit grows by h for each slip (isotropic hardening, b = 0: without end), its middle α
moves by C (kinematic hardening, γ = 0: without end). With d, what p grows by, in the direction ±,

    ±α = C (1 − exp(−γ d))/γ ± α₀ exp(−γ d)

Chaboche (1986), Int. J. Plasticity 2, 149–188; Hardening and UVCuniaxial of OpenSees.
Memory m: u, p, α₀ where a branch begins. Branch 0 is elastic, 1 and 2 slip (forward, backward).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Candidate, Parameter, Values
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import NEVER, Command, Element, opensees_damper
from data.simulation.laws.memory import memory

NEWTON = 8  # iterations of a convex equation whose slope is between 1 and 1 + 2 C + h


@inlined
def _saturating(rate, d):
    """(1 − exp(−rate d))/rate."""
    return -math.expm1(-rate * d) / rate if rate * d > 0.0 else d


@inlined
def _limit(p, slip):
    """The yield limit after a sum of slips."""
    return p[0] + p[4] * _saturating(p[5], slip)


@inlined
def _slip(p, m, side, y):
    """d of a branch that slips, at y."""
    way, back, d = side * (y - m[0]), side * m[2], 0.0
    for _ in range(NEWTON):
        left = math.exp(-p[3] * d)
        moved = p[2] * _saturating(p[3], d) + back * left
        slope = 1.0 + p[4] * math.exp(-p[5] * (m[1] + d)) + (p[2] - p[3] * back) * left
        d = max(d + (way - d - _limit(p, m[1] + d) - moved) / slope, 0.0)
    return d


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of Chaboche
    rho = y - m[0]
    if branch != 0:
        side = way_of(branch)
        rho -= side * _slip(p, m, side, y)
    return p[1] * rho + p[6] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return _limit(p, m[1]) - abs(y - m[0] - m[2])
    return way_of(branch) * ydot


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y - m[0] > m[2] else 2), z, m
    side = way_of(branch)
    d = _slip(p, m, side, y)
    moved = p[2] * _saturating(p[3], d) + side * m[2] * math.exp(-p[3] * d)
    return 0, z, memory(m[0] + side * d, m[1] + d, side * moved)


@checked
@dataclass(frozen=True, kw_only=True)
class Chaboche(Element):
    """Plasticity with isotropic and kinematic hardening. Raises ValueError out of range."""

    by_path = True
    fibres = ("stiffness",)
    yield_displacement: Positive  # y_y [m]
    stiffness: Positive  # k [N/m]
    kinematic_ratio: NotNegative  # C, over k
    kinematic_rate: NotNegative = 0.0  # γ [1/m]
    isotropic_ratio: NotNegative = 0.0  # h, over k
    isotropic_rate: NotNegative = 0.0  # b [1/m]
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def opensees(self) -> list[Command]:
        k, y = self.stiffness, self.yield_displacement
        isotropic, kinematic = k * self.isotropic_ratio, k * self.kinematic_ratio
        metal: Command = ("Hardening", k, k * y, isotropic, kinematic)
        if self.kinematic_rate > 0.0 or self.isotropic_rate > 0.0:
            rate = max(self.isotropic_rate, 1.0 / (NEVER**3 * y))
            limits = isotropic / rate, rate, 0.0, 1.0
            metal = ("UVCuniaxial", k, k * y, *limits, 1, kinematic, self.kinematic_rate)
        return [metal, *opensees_damper(self.damping)]


def _metal(values: Values, between: Sequence[str]) -> list[Element]:
    return [Chaboche(between=between, **values)]


_RATE = Parameter(0.01, 0.5, lambda units: 1.0 / units.elastic, symbol="1/m")
CANDIDATES = (
    Candidate(
        "Chaboche",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "kinematic_ratio": Parameter(0.01, 0.5),
            "kinematic_rate": _RATE,
            "isotropic_ratio": Parameter(0.001, 0.1),
            "isotropic_rate": _RATE,
            "damping": DAMPING,
        },
        _metal,
        number=33,
        yields="yield_displacement",
    ),
)
