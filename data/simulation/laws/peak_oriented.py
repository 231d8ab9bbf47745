"""Hinges that reload towards their peaks, pinch and wear out (Ibarra, Medina & Krawinkler).

ρ = r/k is a length. With u = ±y in the direction of the motion, the envelope is elastic up to y_y,
then y_y + b (u − y_y), beyond the cap y_c with the slope b − d, down to φ y_y. Backward y_y, b and
the line beyond the cap are S times as large. Where an element turns round it unloads with the slope
κ; there is its local peak of that side. On the other side, from u₀ where ρ was zero, it loads
towards one peak after the other: the local one where the line there is steeper than to the global
one (the largest excursion, the yield point at least) and that is higher, then the global one, then
along the envelope. With pinching (Y < 1) it first loads towards

    u_p = X (u_g − f_g/κ),   f_p = Y f_g (u_p − u₀)/(u_g − u₀),

f_g the envelope at the global peak u_g. An element that turns before its force is zero goes back up
to the local peak and on. Energy wears it out: with E the work so far over k, E′ that at the last
zero of the force and β = (E − E′)/(y_y²/δ − E), whenever the force passes zero y_y and b, and the
line beyond the cap, lose the share β on the side that it enters, and u_g grows by it; whenever it
turns κ, 1 to begin with, loses the share β of the energy that is not elastic. With κ = 0 (β ≥ 1) it
is broken and has no force any more.

Ibarra, Medina & Krawinkler (2005), Earthquake Eng. Struct. Dyn. 34, 1489–1511; Lignos & Krawinkler
(2011), J. Struct. Eng. 137(11), 1291–1302; IMKPeakOriented and IMKPinching of OpenSees with one
Λ = y_y/δ and exponents of one. State z: E. Memory m: global peaks forward and backward;
u and ρ of the local ones; u₀; what is left of the strength forward and backward; κ; E′. Branch 0
is elastic; 1, 2 envelope; 3, 4 unloading; then the lines from zero to where it pinches, to the
local and to the global peak, from the local peak to where it pinches and to the global one, from
where it pinches to both; odd ones forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import Fraction, NotNegative, Positive, Share
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

FIRST = 5  # branch of the first line that loads, forward
LEAST = 1e-6  # of the slope of unloading that a turn leaves


@inlined
def _envelope(p, m, side, u):
    """ρ of a side at u ≥ 0."""
    left, full = (m[7], 1.0) if side > 0.0 else (m[8], p[9])
    y = left * p[0]
    if u <= y:
        return u
    rho = y + left * p[2] * (u - y)
    if p[4] > 0.0:
        rho = min(rho, left * (p[0] - p[2] * p[0] + p[4] * p[3]) + (p[2] - p[4]) * u)
    return max(rho, p[5] * full * p[0])


@inlined
def _peaks(p, m, side):
    """Global and local peak of a side, and where it pinches: u_g, f_g, u_l, f_l, u_p, f_p."""
    if side > 0.0:
        far, u, rho = m[0], m[2], m[3]
    else:
        far, u, rho = m[1], m[4], m[5]
    top = _envelope(p, m, side, far)
    pinch = p[7] * (far - top / m[9])
    force = p[8] * top * (pinch - m[6]) / (far - m[6]) if far > m[6] else 0.0
    return far, top, u, rho, pinch, force


@inlined
def _line(p, m, side, line):
    """The ends (u, ρ) of a line."""
    far, top, u, rho, pinch, force = _peaks(p, m, side)
    if line <= 2:
        u0, f0 = m[6], 0.0
    elif line <= 4:
        u0, f0 = u, rho
    else:
        u0, f0 = pinch, force
    if line == 0 or line == 3:
        return u0, f0, pinch, force
    if line == 1 or line == 5:
        return u0, f0, u, rho
    return u0, f0, far, top


@inlined
def _zero(m, side):
    """u at which the force is zero, where it unloads on a side."""
    return m[2] - m[3] / m[9] if side > 0.0 else m[4] - m[5] / m[9]


@inlined
def _shape(p, m, branch, y):
    """ρ of a branch at y."""
    if branch == 0:
        return y
    if m[9] == 0.0:
        return 0.0
    side = way_of(branch)
    u = side * y
    if branch <= 2:
        return side * _envelope(p, m, side, u)
    if branch <= 4:
        return side * m[9] * (u - _zero(m, side))
    u0, f0, u1, f1 = _line(p, m, side, (branch - FIRST) // 2)
    if u1 <= u0:
        return side * f1
    return side * (f0 + (f1 - f0) / (u1 - u0) * (u - u0))


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of PeakOriented
    rho = _shape(p, m, branch, y)
    return p[1] * rho + p[10] * ydot, rho * ydot


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return min(p[0] - y, p[9] * p[0] + y)
    if m[9] == 0.0:
        return 1.0
    side = way_of(branch)
    if branch <= 2:
        return side * ydot
    if branch <= 4:
        return min(side * y - _zero(m, side), (m[2] if side > 0.0 else m[4]) - side * y)
    _, _, u1, _ = _line(p, m, side, (branch - FIRST) // 2)
    return min(side * ydot, u1 - side * y)


@inlined
def _worn(p, m, energy):
    """β at an energy."""
    left = p[0] * p[0] - p[6] * energy
    return min(p[6] * max(energy - m[10], 0.0) / left, 1.0) if left > 0.0 else 1.0


@inlined
def _turned(p, m, side, y, rho, z):
    """What is remembered where an element turns round."""
    worn = _worn(p, m, z - 0.5 * rho * rho / m[9])
    kept = m[9] * max(1.0 - worn, LEAST) if worn < 1.0 else 0.0
    u, f = side * y, side * rho
    if side > 0.0:
        return memory(max(m[0], u), m[1], u, f, m[4], m[5], m[6], m[7], m[8], kept, m[10])
    return memory(m[0], max(m[1], u), m[2], m[3], u, f, m[6], m[7], m[8], kept, m[10])


@inlined
def _entered(p, m, side, zero, z):
    """What is remembered where the force becomes one of a side."""
    worn = _worn(p, m, z)
    left, grown = 1.0 - worn, 1.0 + worn
    if side > 0.0:
        return memory(grown * m[0], m[1], m[2], m[3], m[4], m[5], zero, left * m[7], m[8], m[9], z)
    return memory(m[0], grown * m[1], m[2], m[3], m[4], m[5], zero, m[7], left * m[8], m[9], z)


@inlined
def _steeper(u0, f0, u, f, far, top):
    """Whether the way from a point to a global peak leads over another, lower one."""
    return u0 < u and f0 < f and f < top and (f - f0) * (far - u0) > (top - f0) * (u - u0)


@inlined
def _onward(p, m, side, line):
    """The branch after the end of a line; −1 is the line before all, which ends at u₀."""
    far, top, u, rho, pinch, force = _peaks(p, m, side)
    first = FIRST + (0 if side > 0.0 else 1)
    if line == -1:
        if far <= m[6]:
            return first - 4
        if p[8] < 1.0 and m[6] < pinch:
            return first
        return first + (2 if _steeper(m[6], 0.0, u, rho, far, top) else 4)
    if line == 0 or line == 3:
        return first + (10 if _steeper(pinch, force, u, rho, far, top) else 12)
    if line == 1 or line == 5:
        return first + 8
    return first - 4


@inlined
def _back(p, m, side):
    """The branch beyond the local peak, where an element comes back to it."""
    far, top, u, rho, pinch, force = _peaks(p, m, side)
    first = FIRST + (0 if side > 0.0 else 1)
    if u >= far:
        return first - 4
    under = u < pinch < far and rho < force < top
    if p[8] < 1.0 and under and (force - rho) * (far - u) < (top - rho) * (pinch - u):
        return first + 6
    return first + 8


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        back = p[9] * p[0]
        own = memory(p[0], back, p[0], p[0], back, back, 0.0, 1.0, p[9], 1.0)
        return (1 if y > 0.0 else 2), z, own
    side = way_of(branch)
    if branch == 3 or branch == 4:
        zero = _zero(m, side)
        if side * y > zero:
            return _back(p, m, side), z, m
        m = _entered(p, m, -side, -zero, z)
        return _onward(p, m, -side, -1), z, m
    if branch <= 2 or margin(p, m, branch, y, side, z) >= 0.0:  # it turned
        m = _turned(p, m, side, y, _shape(p, m, branch, y), z)
        return (3 if side > 0.0 else 4), z, m
    return _onward(p, m, side, (branch - FIRST) // 2), z, m


@checked
@dataclass(frozen=True, kw_only=True)
class PeakOriented(Element):
    """Hinges of reinforced concrete or steel: reloading towards peaks, a cap, pinching, wear.

    Without softening, deterioration and pinching it is Clough's law with inner loops that lead to
    the peak of the last loop first. Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    yield_displacement: Positive  # y_y [m]; it yields at k y_y
    stiffness: Positive  # k [N/m]
    hardening_ratio: Fraction  # b, slope after yield over k
    capping_displacement: Positive = 1.0  # y_c [m], of the largest force, where it softens
    softening_ratio: NotNegative = 0.0  # d, by how much less the slope is beyond, over k
    residual_force: Fraction = 0.0  # φ, over k y_y
    deterioration: NotNegative = 0.0  # δ, k y_y² over the energy that wears it out
    pinching_place: Share = 0.0  # X, over the plastic part of the global peak
    pinching_force: Share = 1.0  # Y, over the line to the global peak; 1 is no pinching
    back_strength: Positive = 1.0  # S, backward over forward
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.softening_ratio > 0.0:
            self.require_larger("capping_displacement", "yield_displacement")

    def strengths(self) -> tuple[float, float] | None:
        force = self.stiffness * self.yield_displacement
        return None if self.back_strength == 1.0 else (force, self.back_strength * force)

    def opensees(self) -> list[Command]:
        y = self.yield_displacement
        sides = [*self._side(1.0), *self._side(self.back_strength)]
        capacity = y / self.deterioration if self.deterioration > 0.0 else NEVER**3 * y
        law = (self.stiffness, *sides, *(4 * (capacity,)), *(6 * (1.0,)))
        damper = opensees_damper(self.damping)
        if self.pinching_force == 1.0:
            return [("IMKPeakOriented", *law), *damper]
        return [("IMKPinching", *law, self.pinching_force, 1.0 - self.pinching_place), *damper]

    def _side(self, S: float) -> tuple[float, ...]:
        """Numbers of a side of such a strength in OpenSees: deformations [m], force [N], ratios."""
        d, b, y = self.softening_ratio, self.hardening_ratio, self.yield_displacement
        plastic, falls = NEVER * y, NEVER * y
        if d > 0.0:
            slope, bend = opensees_fall(b, d), b * y * (1.0 - S)
            plastic = S * (d * self.capping_displacement - bend) / (d - bend / y) - S * y
            falls = S * (y + b * plastic) / slope
        force, top = self.stiffness * S * y, 1.0 + b * plastic / y
        return plastic, falls, NEVER * NEVER * y, force, top, self.residual_force


def _hinge(values: Values, between: Sequence[str]) -> list[Element]:
    own = dict(values)
    if "beyond_yield" in own:
        own["capping_displacement"] = own["yield_displacement"] + own.pop("beyond_yield")
    return [PeakOriented(between=between, **own)]


_LAW = {
    "yield_displacement": YIELD,
    "stiffness": STIFFNESS,
    "hardening_ratio": share(0.01, 0.3),
    "deterioration": Parameter(0.003, 0.05, from_zero=True),
    "damping": DAMPING,
}
_PINCHING = {"pinching_place": share(0.2, 0.8), "pinching_force": share(0.1, 0.7)}
_MORE = {
    "beyond_yield": Parameter(0.7, 2.0, lambda units: 0.5 * units.length, symbol="m"),
    "softening_ratio": Parameter(0.02, 0.2, from_zero=True),
    "back_strength": Parameter(0.7, 1.4),
}


def _both(name: str, number: int, parameters: dict[str, Parameter]) -> tuple[Candidate, Candidate]:
    law = Candidate(name, parameters, _hinge, number=number, yields="yield_displacement")
    return law.widened(f"Softening{name}", number + 1, _MORE)


CANDIDATES = (
    *_both("PeakOriented", 27, _LAW),
    *_both("PinchingPeakOriented", 29, _LAW | _PINCHING),
)
