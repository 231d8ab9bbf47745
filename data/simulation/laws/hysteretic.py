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

W the work [J] that was taken up and is not elastic; the state z is the work. Sides are alike, or
the points of the back are its own (Uneven…).

M. H. Scott, HystereticMaterial of OpenSees (2000), after F. C. Filippou. Memory m: y_max forward
and backward, the points of a path (three_lines.py), u₀ forward and backward. Branch 0 is at rest;
1 to 8 are lines of the envelope, 9 to 14 of a path, odd ones forward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import partial

from data.checked import checked
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
from data.simulation.laws.element import Command, Element, opensees_damper
from data.simulation.laws.envelopes import envelopes, names_of, sizes_of
from data.simulation.laws.three_lines import end_of, on_line, points_of, way_of

BACK = 12  # p of the first of the back
FIRST_PATH = 9  # branch
AT_REST = 1e-4  # of Y₁: the element has no direction yet
FARTHEST = 1e16  # y_max: growth that feeds itself ends there in OpenSees, whatever the unit


@inlined
def _place(p, side, i):
    """Y of a point of the envelope of a side, i = 0 (the origin) to 3."""
    if i == 0:
        return 0.0
    return p[i] if side > 0.0 else p[BACK - 1 + i]


@inlined
def _height(p, side, i):
    """ρ there."""
    if i == 0:
        return 0.0
    if side > 0.0:
        return p[1] if i == 1 else p[2 + i] * p[1]
    return p[BACK + 2 + i] * p[1]


@inlined
def _slope(p, side, line):
    """Of ρ on a line of the envelope, 0 to 2."""
    rise = _height(p, side, line + 1) - _height(p, side, line)
    return rise / (_place(p, side, line + 1) - _place(p, side, line))


@inlined
def _line_at(p, side, u):
    """The line of the envelope of a side at u > 0, 0 to 3."""
    for line in range(3):
        if u < _place(p, side, line + 1):
            return line
    return 3


@inlined
def _envelope(p, side, line, u):
    """ρ of a line of the envelope of a side at u."""
    if line == 3:
        return _height(p, side, 3) + max(_slope(p, side, 2), 0.0) * (u - _place(p, side, 3))
    return _height(p, side, line) + _slope(p, side, line) * (u - _place(p, side, line))


@inlined
def _steepness(p, side, peak):
    """E μ^−β of a side."""
    steepest = max(_slope(p, side, 0), _slope(p, side, 1), _slope(p, side, 2))
    return steepest * max(peak / _place(p, side, 1), 1.0) ** -p[10]


@inlined
def _area(p, side):
    """Of ρ under the envelope of a side, up to its last point."""
    area = 0.0
    for i in range(3):
        rho = _height(p, side, i) + _height(p, side, i + 1)
        area += 0.5 * rho * (_place(p, side, i + 1) - _place(p, side, i))
    return area


@inlined
def _shape(p, m, branch, y):
    """ρ = r/k of the branch at y."""
    if branch == 0:
        return y * _slope(p, y, 0)
    side = way_of(branch)
    if branch < FIRST_PATH:
        return side * _envelope(p, side, (branch - 1) // 2, side * y)
    return side * on_line(m, (branch - FIRST_PATH) // 2, side * y)


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of UnevenHysteretic
    r = p[0] * _shape(p, m, branch, y)
    return r + p[11] * ydot, r * ydot


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return AT_REST * min(_place(p, 1.0, 1), _place(p, -1.0, 1)) - abs(y)
    side = way_of(branch)
    if branch < FIRST_PATH:
        line = (branch - 1) // 2
        if line == 3:
            return side * ydot
        return min(side * ydot, _place(p, side, line + 1) - side * y)
    return min(side * ydot, end_of(m, (branch - FIRST_PATH) // 2) - side * y)


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
    return p[8] * (mu - 1.0) + p[9] * lost / (_area(p, 1.0) + _area(p, -1.0))


@inlined
def _turned(p, m, branch, y, rho, z):
    """The path to the other side, and what is remembered."""
    side = way_of(branch)
    here, there = (m[0], m[1]) if side > 0.0 else (m[1], m[0])
    zero_here, zero = (m[10], m[11]) if side > 0.0 else (m[11], m[10])
    if branch < FIRST_PATH:
        here = side * y
    u0, f0, unloading = -side * y, -side * rho, _steepness(p, side, here)
    if f0 <= 0.0:
        zero = u0 - f0 / unloading
        lost = z / p[0] - 0.5 * f0 * f0 / unloading
        there *= 1.0 + _growth(p, here / _place(p, side, 1), lost)
    there = min(max(there, _place(p, -side, 1)), FARTHEST)
    f3 = _envelope(p, -side, _line_at(p, -side, there), there)
    f0, u1, f1, u2, f2, u3, f3 = _path(
        zero, u0, f0, there, f3, unloading, _steepness(p, -side, there), p[6], p[7]
    )
    peaks = (here, there) if side > 0.0 else (there, here)
    zeros = (zero_here, zero) if side > 0.0 else (zero, zero_here)
    return FIRST_PATH + (1 if side > 0.0 else 0), (
        peaks[0], peaks[1], u0, f0, u1, f1, u2, f2, u3, f3, zeros[0], zeros[1]
    )  # fmt: skip


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y > 0.0 else 2), z, m
    side = way_of(branch)
    if branch < FIRST_PATH:
        line = (branch - 1) // 2
        if line < 3 and side * y > _place(p, side, line + 1):
            return branch + 2, z, m
    else:
        line = (branch - FIRST_PATH) // 2
        if side * y > end_of(m, line):
            if line < 2:
                return branch + 2, z, m
            return (1 if side > 0.0 else 2) + 2 * _line_at(p, side, side * y), z, m
    branch, m = _turned(p, m, branch, y, _shape(p, m, branch, y), z)
    return branch, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Hysteretic(Element):
    """Beams, columns and joints: an envelope of three lines, pinching, damage.

    The targets of reloading move away with the ductility and the energy of the other side; the
    slope of unloading falls with the ductility, by a power. Pinching is strong where
    `reloading_place` is near one and `reloading_force` is small; both are one where there is none.
    Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    stiffness: float  # k [N/m]
    yield_displacement: float  # Y₁ [m]; the force there is k Y₁
    displacement_2: float  # Y₂ [m]
    displacement_3: float  # Y₃ [m]
    strength_2: float  # S₂, force at Y₂ over k Y₁
    strength_3: float  # S₃
    reloading_place: float = 1.0  # X, share of the way to where unloading from the target would be
    reloading_force: float = 1.0  # Y, share of the force at the target
    growth_by_ductility: float = 0.0  # D₁
    growth_by_energy: float = 0.0  # D₂
    unloading_exponent: float = 0.0  # β, in [0, 1)
    damping: float = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "stiffness", "yield_displacement", "strength_2", "strength_3")
        self._require("not negative", "growth_by_ductility", "growth_by_energy", "damping")
        self._require_share("unloading_exponent")
        for name in ("reloading_place", "reloading_force"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{type(self).__name__}.{name}={value} must lie in [0, 1]")
        self._require_growing(*PLACES)

    @property
    def parameters(self) -> tuple[float, ...]:
        own = [f.name for f in fields(Hysteretic) if f.name != "between"]
        return (*(float(getattr(self, name)) for name in own), *self._back())

    def _back(self) -> tuple[float, ...]:
        places = (getattr(self, name) for name in PLACES)
        return (*places, 1.0, self.strength_2, self.strength_3)

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping

    def opensees(self) -> list[Command]:
        points = [*points_of(self, PLACES), *self._back_points()]
        damage = (self.growth_by_ductility, self.growth_by_energy, self.unloading_exponent)
        joint = ("Hysteretic", *points, self.reloading_place, self.reloading_force, *damage)
        return [joint, *opensees_damper(self.damping)]

    def _back_points(self) -> list[float]:
        return points_of(self, PLACES, side=-1.0)


@checked
@dataclass(frozen=True, kw_only=True)
class UnevenHysteretic(Hysteretic):
    """The same with its own envelope on the back, where y < 0.

    Forces of the back are over k Y₁ of the front. Raises ValueError for parameters out of range.
    """

    back_yield_displacement: float  # Y₁ of the back [m]
    back_displacement_2: float  # [m]
    back_displacement_3: float  # [m]
    back_strength_1: float  # force at Y₁ of the back
    back_strength_2: float
    back_strength_3: float

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "back_yield_displacement")
        self._require("positive", *(f"back_strength_{i}" for i in (1, 2, 3)))
        self._require_growing(*(f"back_{name}" for name in PLACES))

    def strengths(self) -> tuple[float, float]:
        force = self.stiffness * self.yield_displacement
        return force, self.back_strength_1 * force

    def _back(self) -> tuple[float, ...]:
        strengths = [f"strength_{i}" for i in (1, 2, 3)]
        return tuple(getattr(self, f"back_{name}") for name in (*PLACES, *strengths))

    def _back_points(self) -> list[float]:
        return points_of(self, PLACES, "back_", -1.0)


PLACES = ("yield_displacement", "displacement_2", "displacement_3")
COUNT = 3  # of points
_POINTS = names_of(COUNT)
_OWN = {field.name for field in fields(Hysteretic)} - {"between"}


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    return [Hysteretic(between=between, **_front(values))]


def _uneven(values: Values, between: Sequence[str]) -> list[Element]:
    """The back by what its numbers are times those of the front."""
    strength = values["back_stiffness"] * values["back_yield_displacement"]
    own = {name: values[name] * values[f"back_{name}"] for name in _POINTS}
    back = {"strength_1": strength, **sizes_of(own, COUNT, strength)}
    ends = {f"back_{name}": value for name, value in back.items()}
    return [UnevenHysteretic(between=between, **_front(values), **ends)]


def _front(values: Values) -> dict[str, float]:
    own = {name: value for name, value in values.items() if name in _OWN}
    return own | sizes_of(values, COUNT)


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
OF_BACK = {f"back_{name}": Parameter(0.7, 1.4) for name in ("stiffness", *_POINTS)}
UNEVEN = Candidate(
    "UnevenHysteretic", PARAMETERS | OF_BACK, _uneven, number=12, yields="yield_displacement"
)
ALIKE = Candidate(
    "Hysteretic",
    PARAMETERS,
    _elements,
    number=11,
    yields="yield_displacement",
    read=partial(envelopes, count=COUNT),
    uneven=UNEVEN,
)
CANDIDATES = (ALIKE, UNEVEN)
