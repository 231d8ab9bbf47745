"""A pair of slender braces that only pull, one for each direction, whose slack grows as they yield.

A stop, such as a neighbouring building or an abutment, is the same law with k and g of each side;
k is zero on the side without a stop.

With the slack g at rest and the plastic elongations p₊, p₋ of the two, ρ = r/k for y > 0 is

    0                              y ≤ g + p₊
    y − g − p₊                     until it yields at ρ = y_y + b p₊ / (1 − b)
    y_y + b (y − g − y_y)          while it yields, and p₊ = (1 − b) (y − g − y_y)

and the mirror image, with p₋, for y < 0. The material ElasticPPGap of OpenSees with damage, one in
each direction. Memory m: p₊, p₋. Branch 0 is slack, 1 and 2 taut (y > 0, y < 0), 3 and 4 yield.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from data.annotations import Fraction, NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import (
    BESIDE,
    DAMPING,
    SIDE,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Small,
    Values,
    of_spring,
    share,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import LARGEST_DISPLACEMENT, Command, Element, opensees_damper
from data.simulation.laws.memory import memory
from data.simulation.laws.polynomial import elements_of


@inlined
def _gap(p, side):
    return p[3] if side > 0.0 else p[6]


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = y_y, k, b, g, c; k and g of the back
    r = p[4] * ydot
    if branch == 0:
        return r, 0.0
    side = way_of(branch)
    k, out = (p[1] if side > 0.0 else p[5]), side * y - _gap(p, side)
    if branch <= 2:
        return r + k * side * (out - m[branch - 1]), 0.0
    return r + k * side * (p[0] + p[2] * (out - p[0])), 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return min(_gap(p, 1.0) + m[0] - y, _gap(p, -1.0) + m[1] + y)
    side = way_of(branch)
    if branch > 2:
        return side * ydot
    plastic, out = m[branch - 1], side * y - _gap(p, side)
    return min(out - plastic, p[0] + plastic / (1.0 - p[2]) - out)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y > _gap(p, 1.0) + m[0] else 2), z, m
    side = way_of(branch)
    out = side * y - _gap(p, side)
    if branch <= 2:
        return (0 if out < m[branch - 1] else branch + 2), z, m
    plastic = max(m[branch - 3], (1.0 - p[2]) * (out - p[0]))
    if branch == 3:
        return 1, z, memory(plastic, m[1])
    return 2, z, memory(m[0], plastic)


@checked
@dataclass(frozen=True, kw_only=True)
class SlackBrace(Element):
    """Braces that only pull, one each way, slack by g and by what they have yielded.

    r = k (y − g − p₊) while taut, k [y_y + b (y − g − y_y)] while yielding, 0 in between; mirrored
    for y < 0 with p₋; c ẏ beside. Raises ValueError for parameters out of range.
    """

    by_path = True
    fibres: ClassVar[tuple[str, ...]] = ("stiffness",)
    yield_displacement: Positive  # y_y [m], from taut to yield
    stiffness: Positive  # k [N/m]; it yields at k y_y
    hardening_ratio: Fraction = 0.0  # b, slope after yield over k
    gap: NotNegative = 0.0  # g [m], slack each way at rest
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    @property
    def back(self) -> tuple[float, float]:
        """k and g where y < 0."""
        return self.stiffness, self.gap

    @property
    def parameters(self) -> tuple[float, ...]:
        brace = self.yield_displacement, self.stiffness, self.hardening_ratio, self.gap
        return (*brace, self.damping, *self.back)

    def tangent(self) -> tuple[float, float]:
        sides = (self.stiffness, self.gap), self.back
        return max(k if gap == 0.0 else 0.0 for k, gap in sides), self.damping

    def opensees(self) -> list[Command]:
        y, b = self.yield_displacement, self.hardening_ratio
        sides = (1.0, self.stiffness, self.gap), (-1.0, *self.back)
        braces = [
            ("ElasticPPGap", k, side * k * y, side * gap, b, "damage")
            for side, k, gap in sides
            if k > 0.0
        ]
        return [*braces, *opensees_damper(self.damping)]


@checked
@dataclass(frozen=True, kw_only=True)
class Stop(SlackBrace):
    """A gap that closes on one side, or unlike gaps on both: pounding, abutments.

    k and g are those of the side y > 0. Raises ValueError for parameters out of range.
    """

    fibres = ("stiffness", "back_stiffness")
    yield_displacement: Positive = LARGEST_DISPLACEMENT  # y_y [m]; it stays elastic without
    stiffness: NotNegative = 0.0  # k [N/m] where y > 0; 0: no stop there
    back_stiffness: NotNegative = 0.0  # k [N/m] where y < 0
    back_gap: NotNegative = 0.0  # g [m] where y < 0

    @property
    def back(self) -> tuple[float, float]:
        return self.back_stiffness, self.back_gap

    def strengths(self) -> tuple[float, float]:
        y = self.yield_displacement
        return self.stiffness * y, self.back_stiffness * y


def _begin(law: Candidate, small: Small) -> dict[str, float]:
    """The brace is slack at first: the spring beside it is that of small motions."""
    numbers = of_spring(law, small)
    if small.sure:
        brace = small.spring * math.exp(small.brace)
        numbers |= law.numbers({"spring": small.spring, "stiffness": brace}, small.units)
    return numbers


def _stop(values: Values, between: Sequence[str]) -> list[Element]:
    """A spring, the stiffer stop on its side, and a share of that stop's stiffness opposite."""
    own = dict(values)
    stop = own["stiffness"], own["gap"]
    other = own.pop("other_share") * own["stiffness"], own.pop("other_gap")
    front, back = (stop, other) if own.pop("side") > 0.0 else (other, stop)
    own["stiffness"], own["gap"] = front
    own["back_stiffness"], own["back_gap"] = back
    return elements_of(Stop)(own, between)


GAP = Parameter(0.01, 0.2, lambda units: units.length, symbol="m")
_STOP = {
    "side": SIDE,
    "stiffness": STIFFNESS,
    "gap": GAP,
    "damping": DAMPING,
    "spring": BESIDE,
    "other_share": Parameter(0.1, 0.9, from_zero=True),
    "other_gap": GAP,
}
_YIELDS = {"yield_displacement": YIELD, "hardening_ratio": share(0.01, 0.3)}
CANDIDATES = (
    Candidate(
        "SlackBrace",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "hardening_ratio": share(0.01, 0.3),
            "gap": GAP,
            "damping": DAMPING,
            "spring": BESIDE,
        },
        elements_of(SlackBrace),
        number=2,
        yields="yield_displacement",
        paired=True,
        begin=_begin,
    ),
    Candidate("Stop", _STOP, _stop, number=34, begin=_begin),
    Candidate(
        "YieldingStop",
        _STOP | _YIELDS,
        _stop,
        number=35,
        yields="yield_displacement",
        begin=_begin,
    ),
)
