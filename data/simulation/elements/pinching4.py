"""Pinching with four points: reinforced concrete, walls and joints that pinch, soften and weaken.

ρ = r/k is a length. The envelope goes through four points (Y₁, Y₁), (Y₂, S₂ Y₁), (Y₃, S₃ Y₁),
(Y₄, S₄ Y₁), beyond them on where it rose last, else level; 1 − γ_F of it is left. From where an
element turns round it goes in three lines towards u₃ = (1 + γ_D) times the largest excursion of the
other side, Y₁ at least, on the envelope there (f₃):

    unload with slope 1 − γ_K to a force f₁ = u S Y₁ (S₃, or S₄ beyond Y₃), then straight to
    u₂ = d u₃, f₂ = f f₃, then straight to u₃, f₃.

u, d, f are shares: pinching is strong where u and f are small and d is large. Lines that would be
steeper than 1 − γ_K, or go back, are put between those beside them, or are one straight line. The
losses grow with the largest excursion and the energy that was lost, and are taken when it turns:

    γ = min(γ₁ (y_max / Y₄)^γ₃ + γ₂ (E / E₄)^γ₄, γ_lim),   E₄ = γ_E ∫ envelope,

with numbers of their own for K (unloading), D (reloading) and F (strength). The state z is the work
[J]; E is that less what is elastic. The material Pinching4 of OpenSees, alike on both sides.

Lowes, Mitra & Altoontash (2003), PEER 2003/10; Mitra & Lowes (2007), J. Struct. Eng. ASCE 133,
153–167. Memory m: largest excursions forward and backward; the points 0 to 3 of a path, in the
direction of its motion; γ_F and γ_K. Branch 0 is at rest; 1 to 10 are lines of the envelope, 11 to
16 of a path, odd ones forward.
"""

from __future__ import annotations

from dataclasses import dataclass

from data.checked import checked
from data.simulation.elements.compiling import inlined
from data.simulation.elements.element import Element

PINCHING4 = 10
FIRST_PATH = 11  # branch
AT_REST = 1e-4  # of Y₁: the element has no direction yet
ENOUGH = 0.01  # of the force in the middle, between two points that would change places


@inlined
def _side(branch):
    return 1.0 if branch & 1 else -1.0


@inlined
def _place(p, i):
    """Y of a point of the envelope, i = 0 (the origin) to 4."""
    return 0.0 if i == 0 else p[i]


@inlined
def _height(p, i):
    """ρ there."""
    if i == 0:
        return 0.0
    return p[1] if i == 1 else p[3 + i] * p[1]


@inlined
def _line_at(p, u):
    """The line of the envelope at u > 0, 0 to 4."""
    if u < p[1]:
        return 0
    if u < p[2]:
        return 1
    if u < p[3]:
        return 2
    return 3 if u < p[4] else 4


@inlined
def _envelope(p, line, u):
    """ρ of a line of the whole envelope at u."""
    first = min(line, 3)
    y0, f0, y1, f1 = _place(p, first), _height(p, first), p[first + 1], _height(p, first + 1)
    slope = (f1 - f0) / (y1 - y0)
    if line == 4:
        return f1 + max(slope, 0.0) * (u - y1)
    return f0 + slope * (u - y0)


@inlined
def _shape(p, m, branch, y):
    """ρ = r/k of the branch at y."""
    if branch == 0:
        return y
    side = _side(branch)
    if branch < FIRST_PATH:
        return side * (1.0 - m[10]) * _envelope(p, (branch - 1) // 2, side * y)
    line = (branch - FIRST_PATH) // 2
    if line == 0:
        u0, f0, u1, f1 = m[2], m[3], m[4], m[5]
    elif line == 1:
        u0, f0, u1, f1 = m[4], m[5], m[6], m[7]
    else:
        u0, f0, u1, f1 = m[6], m[7], m[8], m[9]
    return side * (f0 + (f1 - f0) / (u1 - u0) * (side * y - u0))


@inlined
def force(p, m, branch, y, ydot):  # p: as the fields of Pinching4
    r = p[0] * _shape(p, m, branch, y)
    return r + p[27] * ydot, r * ydot


@inlined
def margin(p, m, branch, y, ydot):
    if branch == 0:
        return AT_REST * p[1] - abs(y)
    side = _side(branch)
    if branch < FIRST_PATH:
        line = (branch - 1) // 2
        if line == 4:
            return side * ydot
        return min(side * ydot, p[line + 1] - side * y)
    line = (branch - FIRST_PATH) // 2
    return min(side * ydot, m[4 + 2 * line] - side * y)


@inlined
def _loss(first, second, third, fourth, limit, reach, energy):
    """γ of a largest excursion and an energy, over those of the whole envelope."""
    if energy >= 1.0:
        return limit
    return min(first * reach**third + second * max(energy, 0.0) ** fourth, limit)


@inlined
def _straight(u0, f0, u3, f3, shares):
    u1, u2 = u0 + shares[0] * (u3 - u0), u0 + shares[1] * (u3 - u0)
    return u1, f0 + shares[0] * (f3 - f0), u2, f0 + shares[1] * (f3 - f0)


@inlined
def _bends(p, u0, f0, u3, f3, slope, strength):
    """Points 1 and 2 of a path from (u0, f0) to (u3, f3), unloading with a slope."""
    straight = _straight(u0, f0, u3, f3, (0.33, 0.67))
    if u0 * u3 >= 0.0:
        return straight
    u2, f2 = p[9] * u3, p[10] * f3
    if f3 - f2 > slope * (u3 - u2):
        u2 = u3 - (f3 - f2) / slope
    if u2 < u0:
        return straight
    f1 = p[8] * strength
    u1 = u0 + (f1 - f0) / slope
    if u1 < u0:
        u1, f1 = 0.5 * (u0 + u2), 0.5 * (f0 + f2)
    elif u2 > u1 and f2 - f1 > slope * (u2 - u1):
        return straight
    elif u2 <= u1 or f2 < f1:
        if u2 < u1 and f2 < f1 and f2 - f1 < slope * (u2 - u1):
            return straight
        if u1 > 0.0:
            u1, f1 = 0.5 * (u0 + u2), 0.5 * (f0 + f2)
        elif u2 < 0.0:
            u2, f2 = 0.5 * (u1 + u3), 0.5 * (f1 + f3)
        else:
            first, last = (f1 - f0) / (u1 - u0), (f3 - f2) / (u3 - u2)
            middle = 0.5 * (f1 + f2)
            f1, f2 = middle - ENOUGH * abs(middle), middle + ENOUGH * abs(middle)
            u1, u2 = u0 + (f1 - f0) / first, u3 - (f3 - f2) / last
    if u1 <= u0 or u2 <= u1 or u3 <= u2 or f1 < f0 or f2 < f1 or f3 < f2:
        return straight
    return u1, f1, u2, f2


@inlined
def _secant(p, u):
    """ρ/y of the whole envelope at u > 0."""
    return _envelope(p, _line_at(p, u), u) / u


@inlined
def _energies(p, rho, z, kept):
    """Energy that was lost over that of the whole envelope, unloading with a slope `kept`."""
    area = p[2] + p[5] * (p[3] - p[1]) + p[6] * (p[4] - p[2]) + p[7] * (p[4] - p[3])
    elastic = 0.5 * p[0] * rho * rho / kept
    return (z - elastic) / (p[26] * p[0] * 0.5 * p[1] * area)


@inlined
def _turned(p, m, branch, y, rho, z):
    """The path to the other side, and what is remembered."""
    side = _side(branch)
    here, there = (m[0], m[1]) if side > 0.0 else (m[1], m[0])
    here, there = max(here, p[1]), max(there, p[1])
    energy, reach = _energies(p, rho, z, 1.0 - m[11]), max(here, there) / p[4]
    K = _loss(p[11], p[12], p[13], p[14], p[15], reach, energy)
    K = min(K, max(1.0 - (1.0 - m[10]) * max(_secant(p, here), _secant(p, there)), 0.0))
    D = _loss(p[16], p[17], p[18], p[19], p[20], reach, energy)
    F = _loss(p[21], p[22], p[23], p[24], p[25], reach, energy)
    if branch < FIRST_PATH:
        here = max((1.0 + D) * here, side * y)
    peaks = (here, there) if side > 0.0 else (there, here)
    target, strength = (1.0 + D) * there, p[7] if there > p[3] else p[6]
    u0, f0 = -side * y, -side * rho
    if target <= u0:
        return (2 if side > 0.0 else 1) + 2 * _line_at(p, u0), (
            peaks[0], peaks[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, F, K
        )  # fmt: skip
    f3 = (1.0 - F) * target * _secant(p, target)
    u1, f1, u2, f2 = _bends(p, u0, f0, target, f3, 1.0 - K, (1.0 - F) * strength * p[1])
    return FIRST_PATH + (1 if side > 0.0 else 0), (
        peaks[0], peaks[1], u0, f0, u1, f1, u2, f2, target, f3, F, K
    )  # fmt: skip


@inlined
def next_branch(p, m, branch, y, z):
    if branch == 0:
        return (1 if y > 0.0 else 2), m
    side = _side(branch)
    if branch < FIRST_PATH:
        line = (branch - 1) // 2
        if line < 4 and side * y > p[line + 1]:
            return branch + 2, m
    else:
        line = (branch - FIRST_PATH) // 2
        if side * y > m[4 + 2 * line]:
            if line < 2:
                return branch + 2, m
            return (1 if side > 0.0 else 2) + 2 * _line_at(p, side * y), m
    return _turned(p, m, branch, y, _shape(p, m, branch, y), z)


@checked
@dataclass(frozen=True, kw_only=True)
class Pinching4(Element):
    """Reinforced concrete, walls and joints: an envelope of four points, pinching, three losses.

    It unloads towards `unloading_force` (share of the strength), reloads from `reloading_place` and
    `reloading_force` (shares of the target). Losses of unloading stiffness (`softening`), of
    reloading stiffness (`lengthening`, of the target) and of strength (`weakening`): _by_excursion
    (y_max / Y₄)^_excursion_power + _by_energy (E / E₄)^_energy_power, at most _limit. Raises
    ValueError for parameters out of range.
    """

    law = PINCHING4
    fibres = ("stiffness",)
    stiffness: float  # k [N/m]
    yield_displacement: float  # Y₁ [m]; the force there is k Y₁
    displacement_2: float  # Y₂ [m]
    displacement_3: float  # Y₃ [m]
    displacement_4: float  # Y₄ [m]
    strength_2: float  # S₂, force at Y₂ over k Y₁
    strength_3: float  # S₃
    strength_4: float  # S₄
    unloading_force: float = 0.0  # u, in (−1, 1)
    reloading_place: float = 0.5  # d
    reloading_force: float = 0.25  # f > u, not negative
    softening_by_excursion: float = 0.0  # γ of K
    softening_by_energy: float = 0.0
    softening_excursion_power: float = 1.0
    softening_energy_power: float = 1.0
    softening_limit: float = 0.9
    lengthening_by_excursion: float = 0.0  # γ of D
    lengthening_by_energy: float = 0.0
    lengthening_excursion_power: float = 1.0
    lengthening_energy_power: float = 1.0
    lengthening_limit: float = 0.9
    weakening_by_excursion: float = 0.0  # γ of F
    weakening_by_energy: float = 0.0
    weakening_excursion_power: float = 1.0
    weakening_energy_power: float = 1.0
    weakening_limit: float = 0.9
    energy_capacity: float = 10.0  # γ_E
    damping: float = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        self._require("positive", "stiffness", "yield_displacement", "energy_capacity")
        self._require("positive", "strength_2", "strength_3", "strength_4")
        self._require("not negative", "damping", *(n for n in LOSSES if not n.endswith("limit")))
        self._require_share("reloading_place", *(n for n in LOSSES if n.endswith("limit")))
        places = [self.yield_displacement, self.displacement_2, self.displacement_3]
        places.append(self.displacement_4)
        if sorted(set(places)) != places:
            raise ValueError(
                f"Pinching4: yield_displacement, displacement_2, displacement_3, displacement_4 = "
                f"{places} m must grow from one to the next"
            )
        u, f = self.unloading_force, self.reloading_force
        if not (-1.0 < u < f < 1.0 and f >= 0.0):
            raise ValueError(
                f"Pinching4.unloading_force={u}, reloading_force={f}: expected "
                "−1 < unloading_force < reloading_force < 1, and reloading_force ≥ 0"
            )

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, self.damping


LOSSES = tuple(
    f"{loss}_{part}"
    for loss in ("softening", "lengthening", "weakening")
    for part in ("by_excursion", "by_energy", "excursion_power", "energy_power", "limit")
)
