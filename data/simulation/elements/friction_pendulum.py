"""Sliding bearing on a curved surface, whose friction grows with speed.

    r = W [y/R + μ(|ẏ|) z/Y] + c ẏ,   μ(v) = f_max − (f_max − f_min) exp(−a v)

z sticks (ż = ẏ) while |z| < Y, the small shear of the bearing before it slides, and slides at ±Y.
Constantinou, Mokha & Reinhorn (1990), J. Struct. Eng. ASCE 116, 455–474, whose z/Y is a smooth
Bouc–Wen variable; here it is its limit of large exponent, an elastoplastic slider.
Branch: the slider's side in bits 0–1; bit 2 is set where ẏ < 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from data.checked import checked
from data.simulation.elements.branches import bits, side, slider_margin, slider_next
from data.simulation.elements.compiling import inlined
from data.simulation.elements.element import Element

FRICTION_PENDULUM = 7


@inlined
def force(p, branch, y, ydot, z):  # p = W, R, f_max, f_min, a, Y, c
    sliding = side(branch)
    speed = -ydot if branch & 4 else ydot  # |ẏ| on this branch
    mu = p[2] - (p[2] - p[3]) * math.exp(-p[4] * speed)
    r = p[0] * (y / p[1] + mu * z / p[5]) + p[6] * ydot
    return r, (0.0 if sliding != 0 else ydot)


@inlined
def margin(p, branch, ydot, z):
    speed = -ydot if branch & 4 else ydot
    return min(speed, slider_margin(side(branch), p[5], ydot, z))


@inlined
def next_branch(p, branch, ydot, z):
    sliding, z = slider_next(side(branch), p[5], ydot, z)
    return bits(sliding) | (4 if ydot < 0.0 else 0), z


@checked
@dataclass(frozen=True, kw_only=True)
class FrictionPendulum(Element):
    """Friction pendulum: r = W [y/R + μ(|ẏ|) z/Y] + c ẏ, z elastoplastic at ±Y.

    μ(v) = f_max − (f_max − f_min) exp(−a v). A flat slider has a large R.
    Raises ValueError for parameters out of range.
    """

    law = FRICTION_PENDULUM
    fibres = ("weight",)
    weight: float  # W [N], carried by the bearing
    radius: float  # R [m]
    friction_fast: float  # f_max
    friction_slow: float  # f_min
    rate: float  # a [s/m]
    yield_displacement: float  # Y [m], some 1e-4 to 1e-3
    damping: float = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require(
            "positive", "weight", "radius", "friction_fast", "friction_slow", "yield_displacement"
        )
        self._require("not negative", "rate", "damping")
        if self.friction_slow > self.friction_fast:
            raise ValueError(
                f"FrictionPendulum.friction_slow={self.friction_slow} must not lie above "
                f"friction_fast={self.friction_fast}"
            )

    def tangent(self) -> tuple[float, float]:
        stick = self.friction_slow / self.yield_displacement
        return self.weight * (1.0 / self.radius + stick), self.damping
