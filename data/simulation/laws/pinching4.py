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
over k; E is that less what is elastic. The material Pinching4 of OpenSees. Sides are alike, or
points and shares of the back are its own (Uneven…): then Y₄ and E₄ of losses are the larger ones.

Lowes, Mitra & Altoontash (2003), PEER 2003/10; Mitra & Lowes (2007), J. Struct. Eng. ASCE 133,
153–167. Memory m: largest excursions forward and backward; the points of a path
(straight_lines.py); γ_F and γ_K.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

from data.annotations import Fraction, NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Parameter, Values, share
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, opensees_damper
from data.simulation.laws.envelopes import candidates_of, sizes_of
from data.simulation.laws.straight_lines import (
    AT_REST,
    StraightLines,
    area,
    envelope,
    first_of_path,
    height,
    line_at,
    margin_of,
    next_line,
    place,
    shape,
    slope,
)

ENOUGH = 0.01  # of the force in the middle, between two points that would change places


@inlined
def _shares(p, side):
    """u, d and f of a side."""
    return (p[8], p[9], p[10]) if side > 0.0 else (p[B + 8], p[B + 9], p[B + 10])


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of UnevenPinching4
    rho = shape(p, N, B, m, branch, y, 1.0 - m[10])
    return p[0] * rho + p[27] * ydot, rho * ydot


@inlined
def margin(p, m, branch, y, ydot, z):
    return margin_of(p, N, B, m, branch, y, ydot, AT_REST * p[1])


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
def _bends(shares, u0, f0, u3, f3, unloading, reloading, strength):
    """Points 1 and 2 of a path from (u0, f0) to (u3, f3), from a slope to another at most."""
    straight = _straight(u0, f0, u3, f3, (0.33, 0.67))
    if u0 * u3 >= 0.0:
        return straight
    slope, u2, f2 = max(unloading, reloading), shares[1] * u3, shares[2] * f3
    if f3 - f2 > reloading * (u3 - u2):
        u2 = u3 - (f3 - f2) / reloading
    if u2 < u0:
        return straight
    f1 = shares[0] * strength
    u1 = u0 + (f1 - f0) / unloading
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
def _secant(p, side, u):
    """ρ/y of the whole envelope of a side at u > 0."""
    return envelope(p, N, B, side, line_at(p, N, B, side, u), u) / u


@inlined
def _energies(p, rho, z, kept):
    """Energy that was lost over that of the whole envelope; a share of the stiffness is `kept`."""
    elastic = 0.5 * rho * rho / (kept * slope(p, N, B, rho, 0))
    return (z - elastic) / (p[26] * max(area(p, N, B, 1.0), area(p, N, B, -1.0)))


@inlined
def _turned(p, m, branch, y, rho, z):
    """The path to the other side, and what is remembered."""
    side = way_of(branch)
    here, there = (m[0], m[1]) if side > 0.0 else (m[1], m[0])
    here, there = max(here, place(p, N, B, side, 1)), max(there, place(p, N, B, -side, 1))
    farthest = max(place(p, N, B, side, 4), place(p, N, B, -side, 4))
    energy, reach = _energies(p, rho, z, 1.0 - m[11]), max(here, there) / farthest
    steep, steep_there = slope(p, N, B, side, 0), slope(p, N, B, -side, 0)
    secant = max(_secant(p, side, here) / steep, _secant(p, -side, there) / steep_there)
    K = _loss(p[11], p[12], p[13], p[14], p[15], reach, energy)
    K = min(K, max(1.0 - (1.0 - m[10]) * secant, 0.0))
    D = _loss(p[16], p[17], p[18], p[19], p[20], reach, energy)
    F = _loss(p[21], p[22], p[23], p[24], p[25], reach, energy)
    if branch < first_of_path(N):
        here = max((1.0 + D) * here, side * y)
    peaks = (here, there) if side > 0.0 else (there, here)
    target = (1.0 + D) * there
    strength = height(p, N, B, -side, 4 if there > place(p, N, B, -side, 3) else 3)
    u0, f0 = -side * y, -side * rho
    if target <= u0:
        return (2 if side > 0.0 else 1) + 2 * line_at(p, N, B, -side, u0), (
            peaks[0], peaks[1], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, F, K
        )  # fmt: skip
    f3, left = (1.0 - F) * target * _secant(p, -side, target), 1.0 - K
    u1, f1, u2, f2 = _bends(
        _shares(p, -side), u0, f0, target, f3, left * steep, left * steep_there,
        (1.0 - F) * strength,
    )  # fmt: skip
    return first_of_path(N) + (1 if side > 0.0 else 0), (
        peaks[0], peaks[1], u0, f0, u1, f1, u2, f2, target, f3, F, K
    )  # fmt: skip


@inlined
def next_branch(p, m, branch, y, ydot, z):
    after = next_line(p, N, B, m, branch, y)
    if after == 0:
        after, m = _turned(p, m, branch, y, shape(p, N, B, m, branch, y, 1.0 - m[10]), z)
    return after, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Pinching4(StraightLines):
    """Reinforced concrete, walls and joints: an envelope of four points, pinching, three losses.

    It unloads towards `unloading_force` (share of the strength), reloads from `reloading_place` and
    `reloading_force` (shares of the target). Losses of unloading stiffness (`softening`), of
    reloading stiffness (`lengthening`, of the target) and of strength (`weakening`): _by_excursion
    (y_max / Y₄)^_excursion_power + _by_energy (E / E₄)^_energy_power, at most _limit. Raises
    ValueError for parameters out of range.
    """

    PLACES = ("yield_displacement", "displacement_2", "displacement_3", "displacement_4")
    SHARES = ("unloading_force", "reloading_place", "reloading_force")
    stiffness: Positive  # k [N/m]
    yield_displacement: Positive  # Y₁ [m]; the force there is k Y₁
    displacement_2: float  # Y₂ [m]
    displacement_3: float  # Y₃ [m]
    displacement_4: float  # Y₄ [m]
    strength_2: Positive  # S₂, force at Y₂ over k Y₁
    strength_3: Positive  # S₃
    strength_4: Positive  # S₄
    unloading_force: float = 0.0  # u, in (−1, 1)
    reloading_place: Fraction = 0.5  # d
    reloading_force: float = 0.25  # f > u, not negative
    softening_by_excursion: NotNegative = 0.0  # γ of K
    softening_by_energy: NotNegative = 0.0
    softening_excursion_power: NotNegative = 1.0
    softening_energy_power: NotNegative = 1.0
    softening_limit: Fraction = 0.9
    lengthening_by_excursion: NotNegative = 0.0  # γ of D
    lengthening_by_energy: NotNegative = 0.0
    lengthening_excursion_power: NotNegative = 1.0
    lengthening_energy_power: NotNegative = 1.0
    lengthening_limit: Fraction = 0.9
    weakening_by_excursion: NotNegative = 0.0  # γ of F
    weakening_by_energy: NotNegative = 0.0
    weakening_excursion_power: NotNegative = 1.0
    weakening_energy_power: NotNegative = 1.0
    weakening_limit: Fraction = 0.9
    energy_capacity: Positive = 10.0  # γ_E
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def _require_side(self, back: str) -> None:
        """Check that the points of a side grow, and that its pinching is one."""
        super()._require_side(back)
        u, f = getattr(self, f"{back}unloading_force"), getattr(self, f"{back}reloading_force")
        if not (-1.0 < u < f < 1.0 and f >= 0.0):
            raise ValueError(
                f"{type(self).__name__}.{back}unloading_force={u}, {back}reloading_force={f}: "
                "expected −1 < unloading_force < reloading_force < 1, and reloading_force ≥ 0"
            )

    def opensees(self) -> list[Command]:
        ways = dict(zip(self.sides, (1.0, -1.0), strict=False))
        points = [number for back, side in ways.items() for number in self.points(back, side)]
        named = ("reloading_place", "reloading_force", "unloading_force")
        pinching = [getattr(self, f"{back}{name}") for back in self.sides for name in named]
        losses = [getattr(self, name) for name in LOSSES]
        wall = ("Pinching4", *points, *pinching, *losses, self.energy_capacity, "energy")
        return [wall, *opensees_damper(self.damping)]


# points of a side; p of the first of the back, after all of the front
N, B = len(Pinching4.PLACES), len(fields(Pinching4)) - 1


@checked
@dataclass(frozen=True, kw_only=True)
class UnevenPinching4(Pinching4):
    """The same with its own points and pinching on the back, where y < 0; losses are common.

    Forces of the back are over k Y₁ of the front. Raises ValueError for parameters out of range.
    """

    back_yield_displacement: Positive  # Y₁ of the back [m]
    back_displacement_2: float  # [m]
    back_displacement_3: float  # [m]
    back_displacement_4: float  # [m]
    back_strength_1: Positive  # force at Y₁ of the back
    back_strength_2: Positive
    back_strength_3: Positive
    back_strength_4: Positive
    back_unloading_force: float = 0.0
    back_reloading_place: Fraction = 0.5
    back_reloading_force: float = 0.25


LOSS = {
    "by_excursion": Parameter(0.01, 0.5),
    "by_energy": Parameter(0.01, 0.5),
    "excursion_power": Parameter(0.2, 1.5),
    "energy_power": Parameter(0.2, 1.5),
    "limit": share(0.3, 0.9),
}
KINDS = ("softening", "lengthening", "weakening")
LOSSES = {f"{kind}_{part}": number for kind in KINDS for part, number in LOSS.items()}


def _side(values: Values, strength: float) -> dict[str, float]:
    """Points, by how much farther and stronger each is than the one before, and pinching.

    strength: of the first point, over that of the front.
    """
    own = sizes_of(N, values, strength)
    unloading = 2.0 * values["unloading"] - 1.0
    least = max(unloading, 0.0)
    return own | {
        "reloading_place": values["reloading_place"],
        "unloading_force": unloading,
        "reloading_force": least + (1.0 - least) * values["reloading"],
    }


SHAPE = {
    "unloading": share(0.4, 0.6),
    "reloading_place": share(0.1, 0.8),
    "reloading": share(0.1, 0.6),
}
PARAMETERS = {
    "stiffness": STIFFNESS,
    "yield_displacement": YIELD,
    **{f"farther_{i}": Parameter(0.5, 4.0) for i in (2, 3, 4)},
    "stronger_2": Parameter(1.05, 2.0),
    "stronger_3": Parameter(0.9, 1.4),
    "stronger_4": Parameter(0.4, 1.2),
    **SHAPE,
    **LOSSES,
    "damping": DAMPING,
}
CANDIDATES = candidates_of(Pinching4, UnevenPinching4, PARAMETERS, (7, 10), _side, tuple(SHAPE))
