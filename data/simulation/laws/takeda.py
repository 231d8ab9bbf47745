"""Reinforced concrete after Takeda and Clough: softer with every larger excursion.

ρ = r/k is a length. Elastic up to y_y, then along the backbone, y_y + b (y − y_y). It unloads with
the slope (y_y / y_max)^α, y_max the largest excursion to that side, down to zero force; from there
it loads straight towards the largest excursion of the other side (y_y at least) and goes on along
the backbone. Where it turns round before zero force, it goes back up the unloading line to where it
left, and on as before. α = 0 is Clough's law, 0.3 to 0.5 Takeda's. Unloading is never softer than
the straight line to the largest excursion of the other side.

Clough & Johnston (1966), Proc. Japan Earthquake Eng. Symp., 227–232; Mahin & Bertero (1976),
J. Struct. Div. ASCE 102, 1303–1308, for inner loops; Takeda, Sozen & Nielsen (1970), J. Struct.
Div. ASCE 96, 2557–2573; unloading as in Otani (1981), J. Fac. Eng. Univ. Tokyo 36(2), 125–159.
Memory m: largest excursions y₊ and −y₋; the line through (m₂, m₃) with slope m₄; m₅, where
unloading began. Branch 0 is elastic; 1, 2 backbone (r > 0, r < 0); 3, 4 unloading; 5, 6 reloading.
"""

from __future__ import annotations

from dataclasses import dataclass

from data.annotations import Fraction, NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Candidate, share
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Element
from data.simulation.laws.memory import memory
from data.simulation.laws.polynomial import elements_of


@inlined
def _backbone(p, size):
    return p[0] + p[2] * (size - p[0])


@inlined
def _shape(p, m, branch, y):
    """ρ = r/k of the branch at y."""
    if branch == 0:
        return y
    if branch <= 2:
        return way_of(branch) * _backbone(p, way_of(branch) * y)
    return m[3] + m[4] * (y - m[2])


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = y_y, k, b, α, c
    return p[1] * _shape(p, m, branch, y) + p[4] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return p[0] - abs(y)
    side = way_of(branch)
    if branch <= 2:
        return side * ydot
    if branch <= 4:
        return min(side * (y - m[2]), side * (m[5] - y))
    return min(side * ydot, m[0 if side > 0.0 else 1] - side * y)


@inlined
def _reload(p, m, side, y, rho):
    """Load from (y, ρ) towards the largest excursion of a side."""
    peak = m[0 if side > 0.0 else 1]
    slope = (_backbone(p, peak) - side * rho) / (peak - side * y)
    return (5 if side > 0.0 else 6), memory(m[0], m[1], y, rho, slope)


@inlined
def _unload(p, m, side, y, rho):
    """Unload from (y, ρ) on the line through its point of zero force."""
    here, there = (0, 1) if side > 0.0 else (1, 0)
    peak, other = m[here], m[there]
    chord = (_backbone(p, peak) + _backbone(p, other)) / (peak + other)
    slope = max((p[0] / peak) ** p[3], chord)
    return (3 if side > 0.0 else 4), memory(m[0], m[1], y - rho / slope, 0.0, slope, y)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y > 0.0 else 2), z, memory(p[0], p[0])
    side, rho = way_of(branch), _shape(p, m, branch, y)
    peak, backbone = m[0 if side > 0.0 else 1], 1 if side > 0.0 else 2
    if branch <= 2:
        forward, backward = (max(m[0], y), m[1]) if side > 0.0 else (m[0], max(m[1], -y))
        branch, m = _unload(p, memory(forward, backward), side, y, rho)
        return branch, z, m
    if branch <= 4:
        if side * (y - m[2]) < 0.0:
            branch, m = _reload(p, m, -side, m[2], 0.0)
        elif side * m[5] >= peak:
            branch = backbone
        else:
            branch, m = _reload(p, m, side, m[5], m[4] * (m[5] - m[2]))
        return branch, z, m
    if side * y > peak:
        return backbone, z, m
    branch, m = _unload(p, m, side, y, rho)
    return branch, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Takeda(Element):
    """Concrete that loses stiffness: backbone y_y + b (y − y_y), unloading slope (y_y / y_max)^α.

    Reloads from zero force straight towards the largest excursion of the other side. α = 0 is
    Clough's law. Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    yield_displacement: Positive  # y_y [m]
    stiffness: Positive  # k [N/m], cracked; it yields at k y_y
    hardening_ratio: Fraction  # b, slope after yield over k
    unloading_exponent: Fraction = 0.4  # α
    damping: NotNegative = 0.0  # c [N s/m], beside the law


CANDIDATES = (
    Candidate(
        "Takeda",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "hardening_ratio": share(0.01, 0.3),
            "unloading_exponent": share(0.1, 0.6),
            "damping": DAMPING,
        },
        elements_of(Takeda),
        number=1,
        yields="yield_displacement",
        paired=True,
    ),
)
