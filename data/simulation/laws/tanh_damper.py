"""Dashpot whose force saturates with the rate, r = F tanh(ẏ/v): a relief valve, dry friction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from data.annotations import NotNegative, Positive
from data.checked import checked
from data.simulation.laws.branches import margin, next_branch  # noqa: F401  of one branch
from data.simulation.laws.candidate import Candidate, Parameter, Values
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Element
from data.simulation.laws.power_damper import SPRING, begin_beside_spring, power_spring


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = F, v
    return p[0] * math.tanh(ydot / p[1]), 0.0


@checked
@dataclass(frozen=True, kw_only=True)
class TanhDamper(Element):
    """Dashpot that saturates: r = F tanh(ẏ/v). Raises ValueError for parameters out of range."""

    by_path = True
    fibres = ("force",)
    force: NotNegative  # F [N]
    saturation_rate: Positive  # v [m/s]

    def tangent(self) -> tuple[float, float]:
        return 0.0, self.force / self.saturation_rate


def _elements(values: Values, between: Sequence[str]) -> list[Element]:
    own = {name: values[name] for name in ("force", "saturation_rate")}
    damper = TanhDamper(between=between, **own)
    return [damper, *power_spring(values, between)]


CANDIDATES = (
    Candidate(
        "TanhDamper",
        {
            "force": Parameter(0.3, 2.0, lambda units: units.force, symbol="N"),
            "saturation_rate": Parameter(0.1, 5.0, lambda units: units.rate, symbol="m/s"),
            "spring": SPRING,
        },
        _elements,
        number=19,
        sized=("force",),
        begin=begin_beside_spring,
    ),
)
