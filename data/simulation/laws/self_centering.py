"""Self-centering, flag-shaped: post-tensioned joints, shape-memory braces, rocking walls.

Elastic up to y_a, then with slope b k; unloading falls elastically onto a line that lies β of the
activation force lower, and follows it back to the elastic line through zero. With the slip u,

    r = k (y − u) + c ẏ,   (1 − b) (|y| − y_a)₊ ≤ |u| ≤ (1 − b) (|y| − (1 − β) y_a)₊,  u y ≥ 0

u stays as it is until y drives it along one of these limits.
Christopoulos, Filiatrault & Folz (2002), Earthquake Eng. Struct. Dyn. 31, 1131–1150; the material
SelfCentering of OpenSees without slip and bearing.
State z = u. Branch 0 is elastic, 1 and 2 load (y > 0, y < 0), 3 and 4 unload.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from data.annotations import Fraction, NotNegative, Positive, Range
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import DAMPING, STIFFNESS, YIELD, Candidate, share
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element, opensees_damper
from data.simulation.laws.polynomial import elements_of


@inlined
def _slip(p, branch, y, z):
    """u of a branch at y."""
    if branch == 0:
        return z
    side = way_of(branch)
    onset = p[0] if branch <= 2 else (1.0 - p[3]) * p[0]
    return side * (1.0 - p[2]) * (side * y - onset)


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = y_a, k, b, β, c
    return p[1] * (y - _slip(p, branch, y, z)) + p[4] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    low = (1.0 - p[3]) * p[0]
    if branch == 0:
        if z == 0.0:
            return p[0] - abs(y)
        out = (y if z > 0.0 else -y) - abs(z) / (1.0 - p[2])
        return min(p[0] - out, out - low)
    side = way_of(branch)
    return side * ydot if branch <= 2 else min(-side * ydot, side * y - low)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    low = (1.0 - p[3]) * p[0]
    if branch == 0:
        side = y if z == 0.0 else z
        out = (y if side > 0.0 else -y) - abs(z) / (1.0 - p[2])
        loading = out > 0.5 * (low + p[0])
        return (1 if side > 0.0 else 2) + (0 if loading else 2), z, m
    if branch > 2 and way_of(branch) * y <= low:
        return 0, 0.0, m
    return 0, _slip(p, branch, y, z), m


@checked
@dataclass(frozen=True, kw_only=True)
class SelfCentering(Element):
    """Flag: r = k (y − u) + c ẏ, yielding beyond y_a with slope b k, and back to rest at zero.

    Unloading takes place on a line that lies β of the activation force below that of loading
    (exactly: on the line of slope b k through the elastic one at (1 − β) y_a). β = 1 leaves no
    force at the return to zero. Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    activation_displacement: Positive  # y_a [m]
    stiffness: Positive  # k [N/m]; it opens at k y_a
    hardening_ratio: Fraction  # b, slope after activation over k
    flag: Annotated[float, Range(0, 1, above=True)]  # β, its height over the force y_a k
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def opensees(self) -> list[Command]:
        k, force = self.stiffness, self.stiffness * self.activation_displacement
        flag = ("SelfCentering", k, self.hardening_ratio * k, force, self.flag)
        return [flag, *opensees_damper(self.damping)]


CANDIDATES = (
    Candidate(
        "SelfCentering",
        {
            "activation_displacement": YIELD,
            "stiffness": STIFFNESS,
            "hardening_ratio": share(0.01, 0.3),
            "flag": share(0.3, 0.95),
            "damping": DAMPING,
        },
        elements_of(SelfCentering),
        number=0,
        yields="activation_displacement",
        yield_force="activation_force",
        paired=True,
    ),
)
