"""Hysteretic of OpenSees: an envelope of three lines, pinching, damage, slopes that degrade.

ρ = r/k is a length. On either side the envelope goes through (Y₁, Y₁), (Y₂, S₂ Y₁), (Y₃, S₃ Y₁),
beyond them on where it rose last, else level. Its steepest line has the slope E. From where an
element turns round it unloads with the slope E μ^−β of the side that it leaves, μ = y_max / Y₁, to
zero at u₀, and goes on towards u₃ = y_max of the other side, Y₁ at least, on the envelope there
(f₃):

    from u₀ straight to u₂ = u₀ + X (u₃ − (1 − Y) f₃ / E μ^−β − u₀), f₂ = Y f₃, then to u₃, f₃,

never steeper than E μ^−β of that side; a path that so ends below the envelope steps onto it. An
element that turns before its force is zero reloads with that slope up to the path from where its
force last was zero, and a force above that path steps onto it (β near one). Whenever an element
turns with its force on the side that it leaves, beyond Y₁, y_max of the other side grows by the
share

    D₁ (μ − 1) + D₂ W / A,   A = ∫ envelope of both sides,

W the work over k that was taken up and is not elastic; the state z is the work over k. Sides are
alike, or the points of the back are its own (Uneven…).

M. H. Scott, HystereticMaterial of OpenSees (2000), after F. C. Filippou. Memory m: y_max forward
and backward, the points of a path (straight_lines.py), u₀ forward and backward.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import partial

from data.annotations import Fraction, NotNegative, Positive, Share
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Parameter, share
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, opensees_damper
from data.simulation.laws.envelopes import candidates_of, sizes_of
from data.simulation.laws.straight_lines import (
    AT_REST,
    StraightLines,
    area,
    envelope,
    first_of_path,
    line_at,
    margin_of,
    next_line,
    place,
    shape,
    slope,
)

FARTHEST = 1e16  # y_max: growth that feeds itself ends there in OpenSees, whatever the unit


@inlined
def _steepness(p, side, peak):
    """E μ^−β of a side."""
    steepest = max(slope(p, N, B, side, 0), slope(p, N, B, side, 1), slope(p, N, B, side, 2))
    return steepest * max(peak / place(p, N, B, side, 1), 1.0) ** -p[10]


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of UnevenHysteretic
    rho = shape(p, N, B, m, branch, y, 1.0)
    return p[0] * rho + p[11] * ydot, rho * ydot


@inlined
def margin(p, m, branch, y, ydot, z):
    rest = AT_REST * min(place(p, N, B, 1.0, 1), place(p, N, B, -1.0, 1))
    return margin_of(p, N, B, m, branch, y, ydot, rest)


@inlined
def _met(u, f, steep, u2, f2, u3, f3):
    """Where a slope from (u, f) meets the line from (u2, f2) to (u3, f3); at u3 where it does not.

    Such a slope may end below the envelope, and a line may have no length.
    """
    if u3 > u2:
        slope = (f3 - f2) / (u3 - u2)
        if steep > slope:
            there = u + (f2 + slope * (u - u2) - f) / (steep - slope)
            if u <= there < u3:
                return there, f + steep * (there - u)
    return u3, f + steep * (u3 - u)


@inlined
def _path(zero, u0, f0, u3, f3, unloading, steep, share, height):
    """ρ of point 0 and points 1 to 3 of a path to (u3, f3). zero: u₀ of the side it goes to."""
    elastic = u3 - (1.0 - height) * f3 / steep
    u2, f2 = zero + share * (elastic - zero), height * f3
    pinched = f2 / (u2 - zero) if u2 > zero else steep  # slope
    if f0 <= 0.0:
        if zero >= u3:
            f3 = f0 + unloading * (u3 - u0)
            return f0, u3, f3, u3, f3, u3, f3
        if u2 <= zero or pinched > steep:
            u2, f2 = _met(zero, 0.0, steep, u2, f2, u3, f3)
        return f0, zero, 0.0, u2, f2, u3, min(f3, f2 + steep * (u3 - u2))
    if u0 < u2 or u3 <= u2:
        f0 = min(f0, pinched * max(u0 - zero, 0.0))
        if pinched < steep:
            u1 = u0 + (pinched * (u0 - zero) - f0) / (steep - pinched)
            if u1 < u2:
                return f0, u1, pinched * (u1 - zero), u2, f2, u3, f3
    else:
        f0 = min(f0, f2 + (f3 - f2) * (u0 - u2) / (u3 - u2))
    u1, f1 = _met(u0, f0, steep, u2, f2, u3, f3)
    return f0, u1, f1, u1, f1, u3, min(f3, f1 + steep * (u3 - u1))


@inlined
def _growth(p, mu, lost):
    """Share by which y_max of the other side grows. lost: W over k."""
    if mu <= 1.0:
        return 0.0
    return p[8] * (mu - 1.0) + p[9] * lost / (area(p, N, B, 1.0) + area(p, N, B, -1.0))


@inlined
def _turned(p, m, branch, y, rho, z):
    """The path to the other side, and what is remembered."""
    side = way_of(branch)
    here, there = (m[0], m[1]) if side > 0.0 else (m[1], m[0])
    zero_here, zero = (m[10], m[11]) if side > 0.0 else (m[11], m[10])
    if branch < first_of_path(N):
        here = side * y
    u0, f0, unloading = -side * y, -side * rho, _steepness(p, side, here)
    if f0 <= 0.0:
        zero = u0 - f0 / unloading
        lost = z - 0.5 * f0 * f0 / unloading
        there *= 1.0 + _growth(p, here / place(p, N, B, side, 1), lost)
    there = min(max(there, place(p, N, B, -side, 1)), FARTHEST)
    f3 = envelope(p, N, B, -side, line_at(p, N, B, -side, there), there)
    f0, u1, f1, u2, f2, u3, f3 = _path(
        zero, u0, f0, there, f3, unloading, _steepness(p, -side, there), p[6], p[7]
    )
    peaks = (here, there) if side > 0.0 else (there, here)
    zeros = (zero_here, zero) if side > 0.0 else (zero, zero_here)
    return first_of_path(N) + (1 if side > 0.0 else 0), (
        peaks[0], peaks[1], u0, f0, u1, f1, u2, f2, u3, f3, zeros[0], zeros[1]
    )  # fmt: skip


@inlined
def next_branch(p, m, branch, y, ydot, z):
    after = next_line(p, N, B, m, branch, y)
    if after == 0:
        after, m = _turned(p, m, branch, y, shape(p, N, B, m, branch, y, 1.0), z)
    return after, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Hysteretic(StraightLines):
    """Beams, columns and joints: an envelope of three lines, pinching, damage.

    The targets of reloading move away with the ductility and the energy of the other side; the
    slope of unloading falls with the ductility, by a power. Pinching is strong where
    `reloading_place` is near one and `reloading_force` is small; both are one where there is none.
    Raises ValueError for parameters out of range.
    """

    PLACES = ("yield_displacement", "displacement_2", "displacement_3")
    stiffness: Positive  # k [N/m]
    yield_displacement: Positive  # Y₁ [m]; the force there is k Y₁
    displacement_2: float  # Y₂ [m]
    displacement_3: float  # Y₃ [m]
    strength_2: Positive  # S₂, force at Y₂ over k Y₁
    strength_3: Positive  # S₃
    reloading_place: Share = 1.0  # X, share of the way to where unloading from the target would be
    reloading_force: Share = 1.0  # Y, share of the force at the target
    growth_by_ductility: NotNegative = 0.0  # D₁
    growth_by_energy: NotNegative = 0.0  # D₂
    unloading_exponent: Fraction = 0.0  # β
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def opensees(self) -> list[Command]:
        points = [*self.points("", 1.0), *self.points(self.sides[-1], -1.0)]
        damage = (self.growth_by_ductility, self.growth_by_energy, self.unloading_exponent)
        joint = ("Hysteretic", *points, self.reloading_place, self.reloading_force, *damage)
        return [joint, *opensees_damper(self.damping)]


# points of a side; p of the first of the back, after all of the front
N, B = len(Hysteretic.PLACES), len(fields(Hysteretic)) - 1


@checked
@dataclass(frozen=True, kw_only=True)
class UnevenHysteretic(Hysteretic):
    """The same with its own envelope on the back, where y < 0.

    Forces of the back are over k Y₁ of the front. Raises ValueError for parameters out of range.
    """

    back_yield_displacement: Positive  # Y₁ of the back [m]
    back_displacement_2: float  # [m]
    back_displacement_3: float  # [m]
    back_strength_1: Positive  # force at Y₁ of the back
    back_strength_2: Positive
    back_strength_3: Positive


SHAPE = {
    "reloading_place": share(0.2, 0.9),
    "reloading_force": share(0.1, 0.9),
    "unloading_exponent": share(0.05, 0.5),
}
GROWTH = {"growth_by_ductility": Parameter(1e-3, 0.05), "growth_by_energy": Parameter(3e-3, 0.1)}
PARAMETERS = {
    "stiffness": STIFFNESS,
    "yield_displacement": YIELD,
    **{f"farther_{i}": Parameter(0.5, 4.0) for i in (2, 3)},
    "stronger_2": Parameter(1.05, 2.0),
    "stronger_3": Parameter(0.6, 1.4),
    **SHAPE,
    **GROWTH,
    "damping": DAMPING,
}
CANDIDATES = candidates_of(Hysteretic, UnevenHysteretic, PARAMETERS, (11, 12), partial(sizes_of, N))
