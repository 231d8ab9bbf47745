"""A pair of slender braces that only pull, one for each direction, whose slack grows as they yield.

With the slack g at rest and the plastic elongations p₊, p₋ of the two, ρ = r/k for y > 0 is

    0                              y ≤ g + p₊
    y − g − p₊                     until it yields at ρ = y_y + b p₊ / (1 − b)
    y_y + b (y − g − y_y)          while it yields, and p₊ = (1 − b) (y − g − y_y)

and the mirror image, with p₋, for y < 0. The material ElasticPPGap of OpenSees with damage, one in
each direction. Memory m: p₊, p₋. Branch 0 is slack, 1 and 2 taut (y > 0, y < 0), 3 and 4 yield.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from data.annotations import Fraction, NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import way_of
from data.simulation.laws.candidate import (
    BESIDE,
    DAMPING,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Small,
    of_spring,
    share,
)
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Command, Element, opensees_damper
from data.simulation.laws.memory import memory
from data.simulation.laws.polynomial import elements_of


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = y_y, k, b, g, c
    r = p[4] * ydot
    if branch == 0:
        return r, 0.0
    side = way_of(branch)
    if branch <= 2:
        return r + p[1] * side * (side * y - p[3] - m[branch - 1]), 0.0
    return r + p[1] * side * (p[0] + p[2] * (side * y - p[3] - p[0])), 0.0


@inlined
def margin(p, m, branch, y, ydot, z):
    if branch == 0:
        return min(p[3] + m[0] - y, p[3] + m[1] + y)
    side = way_of(branch)
    if branch > 2:
        return side * ydot
    plastic, out = m[branch - 1], side * y - p[3]
    return min(out - plastic, p[0] + plastic / (1.0 - p[2]) - out)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    if branch == 0:
        return (1 if y > p[3] + m[0] else 2), z, m
    out = way_of(branch) * y - p[3]
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
    fibres = ("stiffness",)
    yield_displacement: Positive  # y_y [m], from taut to yield
    stiffness: Positive  # k [N/m]; it yields at k y_y
    hardening_ratio: Fraction = 0.0  # b, slope after yield over k
    gap: NotNegative = 0.0  # g [m], slack each way at rest
    damping: NotNegative = 0.0  # c [N s/m], beside the law

    def tangent(self) -> tuple[float, float]:
        return (self.stiffness if self.gap == 0.0 else 0.0), self.damping

    def opensees(self) -> list[Command]:
        k, force = self.stiffness, self.stiffness * self.yield_displacement
        braces = [
            ("ElasticPPGap", k, side * force, side * self.gap, self.hardening_ratio, "damage")
            for side in (1.0, -1.0)
        ]
        return [*braces, *opensees_damper(self.damping)]


def _begin(law: Candidate, small: Small) -> dict[str, float]:
    """The brace is slack at first: the spring beside it is that of small motions."""
    numbers = of_spring(law, small)
    if small.sure:
        brace = small.spring * math.exp(small.brace)
        numbers |= law.numbers({"spring": small.spring, "stiffness": brace}, small.units)
    return numbers


CANDIDATES = (
    Candidate(
        "SlackBrace",
        {
            "yield_displacement": YIELD,
            "stiffness": STIFFNESS,
            "hardening_ratio": share(0.01, 0.3),
            "gap": Parameter(0.01, 0.2, lambda units: units.length, symbol="m"),
            "damping": DAMPING,
            "spring": BESIDE,
        },
        elements_of(SlackBrace),
        number=2,
        yields="yield_displacement",
        paired=True,
        begin=_begin,
    ),
)
