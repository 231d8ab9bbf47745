"""Steel after Menegotto & Pinto, with Filippou's isotropic hardening (Steel02 of OpenSees).

Between two turning points the force runs from the elastic line through the last one (y_r, ρ_r) to
the yield line, which the elastic line meets in (y₀, ρ₀); ρ = r/k is a length:

    ρ = ρ_r + (ρ₀ − ρ_r) [b e + (1 − b) e / (1 + |e|^R)^(1/R)],   e = (y − y_r) / (y₀ − y_r)
    R = R₀ [1 − c₁ ξ / (c₂ + ξ)],   ξ = |y_m − y₀| / y_y

y_m is the largest excursion so far towards which the element turns, y_y at least. Past excursions
y₊, y₋ move the yield lines apart, to s y_y, s = 1 + a₁ [(y₊ − y₋) / (2 a₂ y_y)]^0.8 in compression
and a₃, a₄ in tension.

Menegotto & Pinto (1973), IABSE Reports 13; Filippou, Popov & Bertero (1983), EERC 83-19.
Memory m: y_r, ρ_r, y₀, R, y₊, y₋. Branch 0 is the first loading, 1 goes forward, 2 backward.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import Fraction, NotNegative, Positive
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
from data.simulation.laws.memory import memory


@inlined
def _approach(e, b, R):
    """b e + (1 − b) e / (1 + |e|^R)^(1/R), also where |e|^R is beyond all numbers."""
    size = abs(e)
    if size <= 1.0:
        return b * e + (1.0 - b) * e / (1.0 + size**R) ** (1.0 / R)
    return b * e + (1.0 - b) * (e / size) / (1.0 + size**-R) ** (1.0 / R)


@inlined
def _shape(p, m, branch, y):
    """ρ = r/k of the branch at y."""
    b = p[2]
    if branch == 0:
        return p[0] * _approach(y / p[0], b, p[3])
    span = m[2] - m[0]
    return m[1] + span * _approach((y - m[0]) / span, b, m[3])


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = y_y, k, b, R0, c1, c2, a1, a2, a3, a4, c
    return p[1] * _shape(p, m, branch, y) + p[10] * ydot, 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return ydot if y > 0.0 else -ydot if y < 0.0 else abs(ydot)
    return ydot if branch == 1 else -ydot


@inlined
def next_branch(p, m, branch, y, ydot, z):
    """Turn round at y: the new branch and memory."""
    rho, y_y, b = _shape(p, m, branch, y), p[0], p[2]
    forward = branch == 2 or (branch == 0 and y < 0.0)
    highest, lowest = max(y_y, m[4]), min(-y_y, m[5])
    if forward:
        lowest = min(lowest, y)
        a, scale, side, towards = p[8], p[9], 1.0, highest
    else:
        highest = max(highest, y)
        a, scale, side, towards = p[6], p[7], -1.0, lowest
    apart = 1.0 + a * ((highest - lowest) / (2.0 * scale * y_y)) ** 0.8
    span = (apart * y_y * (1.0 - b) - side * (rho - b * y)) / (1.0 - b)
    corner = y + side * max(span, 1e-9 * y_y)  # a turn on the yield line itself has no span
    xi = abs(towards - corner) / y_y
    R = p[3] * (1.0 - p[4] * xi / (p[5] + xi))
    return (1 if forward else 2), z, memory(y, rho, corner, R, highest, lowest)


@checked
@dataclass(frozen=True, kw_only=True)
class MenegottoPinto(Element):
    """Steel: smooth yielding after Menegotto & Pinto, with Filippou's isotropic hardening.

    Between turning points ρ = r/k goes from the elastic line to the yield line of slope b,
    ρ = ρ_r + (ρ₀ − ρ_r) [b e + (1 − b) e / (1 + |e|^R)^(1/R)], e = (y − y_r) / (y₀ − y_r); R falls
    with the plastic excursion. R₀, c₁, c₂, a₁ … a₄ are those of Steel02 in OpenSees. Raises
    ValueError for parameters out of range.
    """

    by_path = True
    fibres = ("stiffness",)
    yield_displacement: Positive  # y_y [m]
    stiffness: Positive  # k [N/m]; it yields at k y_y
    hardening_ratio: Fraction  # b, slope after yield over k
    sharpness: Positive = 20.0  # R₀, of the first loading
    sharpness_loss: Fraction = 0.925  # c₁, loss of sharpness, at most
    loss_excursion: Positive = 0.15  # c₂, plastic excursion, in y_y, by which half of it is lost
    a1: NotNegative = 0.0  # isotropic hardening in compression
    a2: Positive = 1.0
    a3: NotNegative = 0.0  # isotropic hardening in tension
    a4: Positive = 1.0
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def opensees(self) -> list[Command]:
        k, shape = self.stiffness, (self.sharpness, self.sharpness_loss, self.loss_excursion)
        hardening = (self.a1, self.a2, self.a3, self.a4)
        force, ratio = k * self.yield_displacement, self.hardening_ratio
        steel = ("Steel02", force, k, ratio, *shape, *hardening)
        return [steel, *opensees_damper(self.damping)]


def _steel(values: Values, between: Sequence[str]) -> list[Element]:
    """uneven: how many times as much the yield line grows in compression as in tension."""
    uneven = values.get("uneven", 1.0) ** 0.5
    growth = {"a1": values["growth"] * uneven, "a3": values["growth"] / uneven}
    own = {name: value for name, value in values.items() if name not in ("growth", "uneven")}
    return [MenegottoPinto(between=between, **own, **growth)]


_PARAMETERS = {
    "yield_displacement": YIELD,
    "stiffness": STIFFNESS,
    "hardening_ratio": share(0.01, 0.2),
    "sharpness": Parameter(5.0, 25.0),
    "sharpness_loss": share(0.8, 0.95),
    "loss_excursion": Parameter(0.05, 0.3),
    "growth": Parameter(0.003, 0.1),
    "damping": DAMPING,
}
CANDIDATES = Candidate(
    "MenegottoPinto", _PARAMETERS, _steel, number=5, yields="yield_displacement", paired=True
).widened("UnevenMenegottoPinto", 9, {"uneven": Parameter(0.9, 1.1)})
