"""Timber shear walls: nails that bend and crush the wood around them (the CUREE law).

ρ = r/k is a length. With u = ±y in the direction of the motion, the envelope is

    e(u) = (y₀ + b u) (1 − exp(−u / y₀))   up to y_u, beyond with the slope b − d, down to zero,

or without such an end where d = 0. Where an element turns round it unloads with the slope R to a
line on which the nails slip, ρ = φ y₀ + P u, and follows it to the line that reloads,

    ρ = e(w) + (y₀ / w)^α (u − w),   w = g y_max,

to the envelope at w (to its maximum, e(y_u), where y_max < y_u < w), but not before the envelope is
above the slip line; on a side where the wall never was, to the envelope there. y_max is the largest
place at which the envelope of a side was left for the slip line. An element that turns before it
has come to the slip line goes back on the line on which it came, and then on as before.

Folz & Filiatrault (2001), J. Struct. Eng. 127(4), 361–370; the material SAWS of OpenSees.
Memory m: y_max forward and backward; the points of a path (straight_lines.py); where it unloads, y
where it left another line, and ±1 for the envelope, ±2 for the slip line, ±3 for reloading, by the
direction there. Branch 0 is elastic on the envelope, below the slip line; 1, 2 envelope; 3 to 8 the
lines of a path, odd ones forward.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from data.annotations import Fraction, NotNegative, Positive, Range
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import (
    DAMPING,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Values,
    share,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import NEVER, Command, Element, opensees_damper, opensees_fall
from data.simulation.laws.memory import memory
from data.simulation.laws.straight_lines import end_of, first_of_path, on_line

PATH = first_of_path(0)
ELASTIC = 1.05  # of where the envelope crosses the slip line: up to there SAWS is elastic


@inlined
def _envelope(p, u):
    """ρ at u > 0."""
    near = min(u, p[3]) if p[4] > 0.0 else u
    rho = (p[0] + p[2] * near) * -math.expm1(-near / p[0])
    return max(rho + (p[2] - p[4]) * (u - near), 0.0)


@inlined
def _slip(p, u):
    """ρ of the slip line."""
    return p[6] * p[0] + p[7] * u


@inlined
def _shape(p, m, branch, y):
    """ρ of a branch at y."""
    if branch == 0:
        return math.copysign(_envelope(p, abs(y)), y)
    side = way_of(branch)
    if branch < PATH:
        return side * _envelope(p, side * y)
    if (branch - PATH) // 2 == 1:
        return side * _slip(p, side * y)
    return side * on_line(m, (branch - PATH) // 2, side * y)


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of NailedWall, y₀ first, then k
    return p[1] * _shape(p, m, branch, y) + p[10] * ydot, 0.0


@inlined
def _above(p, u):
    """How far the slip line is above the envelope."""
    return _slip(p, u) - _envelope(p, max(u, 0.0))


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return _above(p, abs(y) / ELASTIC)
    side = way_of(branch)
    if branch < PATH:
        return side * ydot
    line = (branch - PATH) // 2
    end = end_of(m, line) - side * y
    return min(side * ydot, max(end, _above(p, side * y)) if line == 1 else end)


@inlined
def _path(p, peak, u0, f0):
    """Points 1 to 3 of a path from (u0, f0) towards a side whose y_max is `peak`."""
    u1 = u0 + (_slip(p, u0) - f0) / (p[5] - p[7])
    if peak == 0.0:  # the slip line ends at the envelope
        return u1, _slip(p, u1), u1, 0.0, u1, 0.0
    u3 = p[9] * peak
    f3 = _envelope(p, min(u3, p[3]) if peak < p[3] and p[4] > 0.0 else u3)
    slope = (p[0] / u3) ** p[8]
    u1, u2 = min(u1, u3), u3
    if slope > p[7]:
        u2 = min(max((_slip(p, 0.0) - f3 + slope * u3) / (slope - p[7]), u1), u3)
    return u1, f0 + p[5] * (u1 - u0), u2, f3 + slope * (u2 - u3), u3, f3


@inlined
def _turned(p, m, branch, y, rho):
    """The path to the other side, and what is remembered."""
    side = way_of(branch)
    u0, f0 = -side * y, -side * rho
    line = (branch - PATH) // 2
    u1, f1, u2, f2, u3, f3 = _path(p, m[1 if side > 0.0 else 0], u0, f0)
    left, which = y, side * (1.0 + max(line, 0))
    if line == 0:
        left, which = m[10], m[11]
        back = -side * which
        if back == 1.0 or back == 3.0:
            u1, f1 = -side * left, f0 + p[5] * (-side * left - u0)
            u2, f2 = u1, f1
            if back == 1.0:
                u3, f3 = u1, f1
    return PATH + (1 if side > 0.0 else 0), (
        m[0], m[1], u0, f0, u1, f1, u2, f2, u3, f3, left, which
    )  # fmt: skip


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y > 0.0 else 2), z, m
    side, envelope = way_of(branch), 1 if branch & 1 else 2
    line = (branch - PATH) // 2
    if line < 0 or margin(p, m, branch, y, side, z) >= 0.0:  # it turned
        branch, m = _turned(p, m, branch, y, _shape(p, m, branch, y))
        return branch, z, m
    if line == 0:
        back, forward, backward = side * m[11], m[0], m[1]
        if back == -1.0:
            forward, backward = max(forward, m[10]), max(backward, -m[10])
        after = envelope if back == 1.0 else branch + (4 if back == 3.0 else 2)
        return after, z, memory(forward, backward, m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9])
    if line == 1 and m[0 if side > 0.0 else 1] > 0.0:
        return branch + 2, z, m
    return envelope, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class NailedWall(Element):
    """Wood panels on studs: a curved envelope, nails that slip, reloading ever softer.

    The line of reloading goes to an envelope farther out than the wall has been, so that the same
    deformation needs less force the second time. Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    yield_displacement: Positive  # y₀ [m]; k y₀ is where the asymptote begins
    stiffness: Positive  # k [N/m]
    hardening_ratio: Fraction  # b, slope of the asymptote over k
    ultimate_displacement: Positive  # y_u [m]
    softening_ratio: NotNegative  # d, by how much less the slope is beyond, over k
    unloading_ratio: Annotated[float, Range(0, above=True)]  # R, over k
    slip_force: Fraction  # φ, force of the slip line at zero over k y₀
    slip_ratio: Fraction  # P, its slope over k
    degradation: NotNegative  # α
    growth: Positive  # g
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_larger("unloading_ratio", "slip_ratio")

    def opensees(self) -> list[Command]:
        y, k, b = self.yield_displacement, self.stiffness, self.hardening_ratio
        farthest, falls = NEVER * y, 1.0
        if self.softening_ratio > 0.0:
            farthest, falls = self.ultimate_displacement, opensees_fall(b, self.softening_ratio)
        wall = ("SAWS", k * y, self.slip_force * k * y, farthest, k, b, -falls)
        more = (self.unloading_ratio, self.slip_ratio, self.degradation, self.growth)
        return [(*wall, *more), *opensees_damper(self.damping)]


def _wall(values: Values, between: Sequence[str]) -> list[Element]:
    own = {"ultimate_displacement": NEVER * values["yield_displacement"], "softening_ratio": 0.0}
    own |= values
    own["unloading_ratio"] = own["slip_ratio"] + own.pop("steeper")
    return [NailedWall(between=between, **own)]


_SOFTENING = {
    "ultimate_displacement": Parameter(0.7, 2.0, lambda units: 0.5 * units.length, symbol="m"),
    "softening_ratio": Parameter(0.05, 0.2, from_zero=True),
}
CANDIDATES = Candidate(
    "NailedWall",
    {
        "yield_displacement": YIELD,
        "stiffness": STIFFNESS,
        "hardening_ratio": share(0.01, 0.3),
        "steeper": Parameter(1.0, 1.5, word="unloading_ratio_less_slip_ratio"),
        "slip_force": share(0.05, 0.5),
        "slip_ratio": share(0.01, 0.1),
        "degradation": share(0.3, 0.9),
        "growth": Parameter(1.0, 1.3),
        "damping": DAMPING,
    },
    _wall,
    number=25,
    yields="yield_displacement",
).widened("SofteningNailedWall", 26, _SOFTENING)
