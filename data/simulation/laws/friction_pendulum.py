"""Sliding bearing on a curved surface, whose friction grows with speed.

    r = W [y/R + μ(|ẏ|) z/Y] + c ẏ,   μ(v) = f_max − (f_max − f_min) exp(−a v)

z sticks (ż = ẏ) while |z| < Y, the small shear of the bearing before it slides, and slides at ±Y.
Constantinou, Mokha & Reinhorn (1990), J. Struct. Eng. ASCE 116, 455–474, whose z/Y is a smooth
Bouc–Wen variable; here it is its limit of large exponent, an elastoplastic slider. So the stiffness
of what sticks, W μ/Y, grows with speed. That of a spring in series with the slider does not, as in
singleFPBearing of OpenSees; the share s of it goes from one (s = 0) to the other (s = 1):

    r = W [y/R + μ z/Z] + c ẏ,   Z(|ẏ|) = Y (μ/f_min)ˢ

Where it turns round, μ = f_min and Z = Y. Angles are small. On a circle, of curvature κ = 1/R, the
weight is in equilibrium with

    r = (W y/(R cos θ) + F) / (1 − F tan θ/W) + c ẏ,   F = W μ z/Z,   sin θ = κ y

which is W tan(θ ± arctan μ) where it slides.
Branch: the slider's side in bits 0–1; bit 2 is set where ẏ < 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive, Share
from data.checked import checked
from data.simulation.laws.branches import bits, side, slider_margin, slider_next
from data.simulation.laws.candidate import DAMPING, Candidate, Parameter, Small, Values
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import SAME, Command, Element

STEEPEST = 0.1  # cos θ, and 1 − F tan θ/W: no weight goes up to where a slope would not let it


@inlined
def _speed(branch, ydot):
    """|ẏ| on this branch."""
    return -ydot if branch & 4 else ydot


@inlined
def _friction(p, speed):
    return p[2] - (p[2] - p[3]) * math.exp(-p[4] * speed)


@inlined
def _shear(p, mu):
    """Z, where what sticks begins to slide."""
    return p[5] if p[7] == 0.0 else p[5] * (mu / p[3]) ** p[7]


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = W, R, f_max, f_min, a, Y, c, s, κ
    sliding = side(branch)
    mu = _friction(p, _speed(branch, ydot))
    part = sliding if sliding != 0 else z / _shear(p, mu)
    push = mu * part
    if p[8] == 0.0:
        r = p[0] * (y / p[1] + push)
    else:
        cosine = math.sqrt(max(1.0 - (p[8] * y) ** 2, STEEPEST**2))
        held = max(1.0 - push * p[1] * p[8] ** 2 * y / cosine, STEEPEST)
        r = p[0] * (y / (p[1] * cosine) + push) / held
    return r + p[6] * ydot, (0.0 if sliding != 0 else ydot)


@inlined
def margin(p, m, branch, y, ydot, z):
    speed = _speed(branch, ydot)
    shear = _shear(p, _friction(p, speed))
    return min(speed, slider_margin(side(branch), shear, ydot, z))


@inlined
def next_branch(p, m, branch, y, ydot, z):
    """What slides has z = ±Y, from which it sticks where it has turned round."""
    shear = _shear(p, _friction(p, _speed(branch, ydot)))
    sliding = side(branch)
    if slider_margin(sliding, shear, ydot, z) < 0.0:
        sliding, z = slider_next(sliding, shear, ydot, z)
        z = min(max(z, -p[5]), p[5])
    return bits(sliding) | (4 if ydot < 0.0 else 0), z, m


@checked
@dataclass(frozen=True, kw_only=True)
class FrictionPendulum(Element):
    """Friction pendulum: r = W [y/R + μ(|ẏ|) z/Y] + c ẏ, z elastoplastic at ±Y.

    μ(v) = f_max − (f_max − f_min) exp(−a v). A flat slider has a large R. spring_share is 0 after
    Constantinou, Mokha & Reinhorn (1990), as above; it is 1 where what sticks is a spring of
    stiffness W f_min/Y in series with the slider, as in OpenSees. curvature is 0 for small angles,
    and 1/R for equilibrium on the circle.
    Raises ValueError for parameters out of range.
    """

    fibres = ("weight",)
    weight: Positive  # W [N], carried by the bearing
    radius: Positive  # R [m]
    friction_fast: Positive  # f_max
    friction_slow: Positive  # f_min
    rate: NotNegative  # a [s/m]
    yield_displacement: Positive  # Y [m], some 1e-4 to 1e-3
    damping: NotNegative = 0.0  # c [N s/m], beside the law
    spring_share: Share = 0.0  # s
    curvature: NotNegative = 0.0  # κ [1/m]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.friction_slow > self.friction_fast:
            raise ValueError(
                f"FrictionPendulum.friction_slow={self.friction_slow} must not lie above "
                f"friction_fast={self.friction_fast}"
            )

    def tangent(self) -> tuple[float, float]:
        stick = self.friction_slow / self.yield_displacement
        return self.weight * (1.0 / self.radius + stick), self.damping

    def opensees(self) -> list[Command]:
        if self.friction_fast - self.friction_slow > SAME * self.friction_fast:
            raise ValueError(
                "friction that grows with speed has no stock material between two nodes"
            )
        if self.curvature > 0.0:
            raise ValueError("a curved surface (curvature) has no stock material between two nodes")
        slider = self.weight * self.friction_fast / self.yield_displacement
        return [
            ("Elastic", self.weight / self.radius, self.damping),
            ("ElasticPP", slider, self.yield_displacement),
        ]


def _bearing(values: Values, between: Sequence[str]) -> list[Element]:
    """By forces: the weight is one, so that friction and curvature are what they do."""
    slow, fast = values["slow"], values["slow"] + values["faster"]
    bearing = FrictionPendulum(
        between=between,
        weight=1.0,
        radius=1.0 / values["stiffness"],
        friction_fast=fast,
        friction_slow=slow,
        rate=values["rate"],
        yield_displacement=values["yield_displacement"],
        damping=values["damping"],
        spring_share=values.get("spring_share", 0.0),
        curvature=values.get("curvature", 0.0),
    )
    return [bearing]


def _begin(law: Candidate, small: Small) -> dict[str, float]:
    """The spring of small motions is what sticks, which is short; it slides at a force."""
    numbers = {"slow": small.bend}
    if small.sure:
        shear = math.exp(small.bend) * small.units.force / small.spring
        sizes = {"yield_displacement": shear, "damping": small.damper}
        numbers |= law.numbers(sizes, small.units)
    return numbers


_PARAMETERS = {
    "stiffness": Parameter(0.1, 1.0, lambda units: units.force / units.length, symbol="N/m"),
    "slow": Parameter(0.05, 0.5, lambda units: units.force, symbol="N", word="friction_slow"),
    "faster": Parameter(
        0.02, 0.5, lambda units: units.force, symbol="N", word="friction_fast_less_slow"
    ),
    "rate": Parameter(0.3, 3.0, lambda units: 1.0 / units.rate, symbol="s/m", word="friction_rate"),
    "yield_displacement": Parameter(0.05, 1.0, lambda units: units.elastic, symbol="m"),
    "damping": DAMPING,
}
_CURVED = {
    "spring_share": Parameter(0.1, 0.9, from_zero=True),
    "curvature": Parameter(  # its radius is twice the largest deformation at least
        0.1, 0.5, lambda units: 0.5 / units.length, from_zero=True, symbol="1/m"
    ),
}
CANDIDATES = Candidate(
    "FrictionPendulum",
    _PARAMETERS,
    _bearing,
    number=3,
    paired=True,
    sized=("stiffness", "slow", "faster"),
    begin=_begin,
).widened("CurvedFrictionPendulum", 15, _CURVED)
