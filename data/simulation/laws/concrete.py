"""Concrete that crushes on one side and cracks on the other: a strut, a wall that rocks, a fibre.

ρ = r/k is a length. With u = ±y, positive where it crushes, the envelope is

    u (1 − u / 2y_c)   up to y_c, then straight to φ y_c/2 at y_u, and that beyond.

From u_m, the largest u so far, where the envelope was ρ_m, the lines ρ = E (u − u₀) and half of it
enclose unloading and reloading; both end in the plastic deformation u₀ = u_m − ρ_m/E. The first
leads through the focus (−F, −F), E = (ρ_m + F) / (u_m + F), so that E falls as the concrete
crushes. Between them the slope is that of k. Opened by w = u₀ − u it pulls: up to y_t along the
elastic line, then ever less, by t for each w, down to nothing; where it closes and opens again, on
the straight line to the widest crack w_m.

Yassin (1994), PhD thesis, Berkeley; Concrete02 of OpenSees, whose λ = (φ y_c/2 + F)/(y_u + F).
Memory m: u_m; w_m; u and ρ where an elastic line began. Branch 0 is elastic, not cracked
yet; 1 envelope; 2 elastic; 3, 4 the lines of E and of half of it; 5 a crack; 6 one that grows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive, Share
from data.checked import checked
from data.simulation.laws.candidate import (
    DAMPING,
    SIDE,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Values,
    share,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import NEVER, Command, Element, opensees_damper
from data.simulation.laws.memory import memory
from data.simulation.laws.straight_lines import AT_REST


@inlined
def _side(p):
    """The direction in which it crushes."""
    return 1.0 if p[7] > 0.0 else -1.0


@inlined
def _envelope(p, u):
    """ρ at u ≥ 0."""
    if u <= p[0]:
        return u * (1.0 - 0.5 * u / p[0])
    top, residual = 0.5 * p[0], 0.5 * p[2] * p[0]
    return max(top + (residual - top) * (u - p[0]) / (p[3] - p[0]), residual)


@inlined
def _lines(p, m):
    """E and u₀."""
    rho = _envelope(p, m[0])
    E = (rho + p[4]) / (m[0] + p[4])
    return E, m[0] - rho / E


@inlined
def _pull(p, w):
    """−ρ of a crack that grows, at w."""
    return max(p[5] - p[6] * (w - p[5]), 0.0)


@inlined
def _shape(p, m, branch, u):
    """ρ of a branch at u."""
    if branch == 0:
        return _envelope(p, u) if u > 0.0 else u
    if branch == 1:
        return _envelope(p, u)
    if branch == 2:
        return m[3] + u - m[2]
    E, zero = _lines(p, m)
    if branch <= 4:
        return (E if branch == 3 else 0.5 * E) * (u - zero)
    if branch == 6:
        return -_pull(p, zero - u)
    widest = max(m[1], p[5])
    return _pull(p, widest) / widest * (u - zero)


@inlined
def force(p, m, branch, y, ydot, z, work):  # p: as the fields of Concrete
    side = _side(p)
    return side * p[1] * _shape(p, m, branch, side * y) + p[8] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    side = _side(p)
    u, rate = side * y, side * ydot
    if branch == 0:
        return min(AT_REST * p[0] - u, u + p[5])
    if branch == 1:
        return rate
    E, zero = _lines(p, m)
    if branch == 2:
        rho = _shape(p, m, branch, u)
        return min(E * (u - zero) - rho, rho - 0.5 * E * (u - zero))
    if branch == 3:
        return min(rate, m[0] - u)
    if branch == 4:
        return min(-rate, u - zero)
    if branch == 5:
        return min(zero - u, max(m[1], p[5]) - (zero - u))
    return min(-rate, p[5] + p[5] / p[6] - (zero - u))


@inlined
def _opened(p, m):
    """A crack, and the memory there: without any pull left, it is as wide as can be."""
    gone = _pull(p, max(m[1], p[5])) == 0.0
    return 5, memory(m[0], NEVER * p[0] if gone else m[1], m[2], m[3])


@inlined
def next_branch(p, m, branch, y, ydot, z):
    u = _side(p) * y
    E, zero = _lines(p, m)
    if branch == 0:
        if u > 0.0:
            return 1, z, m
        if p[5] > 0.0:
            return 6, z, m
    elif branch == 1:
        return 2, z, memory(u, m[1], u, _envelope(p, u))
    elif branch == 2:
        return (3 if _shape(p, m, 2, u) > 0.75 * E * (u - zero) else 4), z, m
    elif branch == 3:
        if u >= m[0]:
            return 1, z, m
        return 2, z, memory(m[0], m[1], u, _shape(p, m, 3, u))
    elif branch == 4:
        if u > zero:
            return 2, z, memory(m[0], m[1], u, _shape(p, m, 4, u))
    elif branch == 5:
        if u >= zero:
            return 3, z, m
        return 6, z, m
    else:
        m = memory(m[0], max(zero - u, m[1]), m[2], m[3])
    branch, m = _opened(p, m)
    return branch, z, m


@checked
@dataclass(frozen=True, kw_only=True)
class Concrete(Element):
    """Concrete under deformations to one side: it crushes there and cracks on the other.

    Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    peak_displacement: Positive  # y_c [m], of the largest force, k y_c/2
    stiffness: Positive  # k [N/m]
    residual_force: Share  # φ, over the largest force
    ultimate_displacement: Positive  # y_u [m], where that is reached
    focus: Positive  # F [m], where all lines of reloading meet
    cracking_displacement: NotNegative = 0.0  # y_t [m]; 0: nothing pulls
    tension_softening: Positive = 0.05  # t, slope over k
    forward: bool = False  # whether it crushes where y > 0
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_larger("ultimate_displacement", "peak_displacement")

    def strengths(self) -> tuple[float, float]:
        crushes = 0.5 * self.stiffness * self.peak_displacement
        cracks = self.stiffness * self.cracking_displacement
        return (crushes, cracks) if self.forward else (cracks, crushes)

    def opensees(self) -> list[Command]:
        if self.forward:
            raise ValueError("concrete that crushes forward is no stock material of OpenSees")
        k, y, F = self.stiffness, self.peak_displacement, self.focus
        top, residual = 0.5 * y, 0.5 * y * self.residual_force
        slope = (residual + F) / (self.ultimate_displacement + F)
        crushes = -k * top, -y, -k * residual, -self.ultimate_displacement, slope
        cracks = k * self.cracking_displacement, k * self.tension_softening
        return [("Concrete02", *crushes, *cracks), *opensees_damper(self.damping)]


def _concrete(values: Values, between: Sequence[str]) -> list[Element]:
    own = dict(values)
    longer = 0.5 * (1.0 - own["residual_force"]) / own.pop("softening_ratio")  # of y_c, to y_u
    own["ultimate_displacement"] = own["peak_displacement"] * (1.0 + longer)
    forward = own.pop("side") > 0.0
    return [Concrete(between=between, forward=forward, **own)]


CANDIDATES = (
    Candidate(
        "Concrete",
        {
            "peak_displacement": YIELD,
            "stiffness": STIFFNESS,
            "residual_force": share(0.1, 0.9),
            "softening_ratio": Parameter(0.02, 0.3),
            "focus": Parameter(0.3, 3.0, lambda units: units.elastic, symbol="m"),
            "cracking_displacement": Parameter(0.02, 0.2, lambda units: units.elastic, symbol="m"),
            "tension_softening": Parameter(0.01, 0.3),
            "side": SIDE,
            "damping": DAMPING,
        },
        _concrete,
        number=32,
        yields="peak_displacement",
        yield_force="largest_force",
        paired=True,
    ),
)
