"""Bouc–Wen hysteresis whose state is the force. Brewick & Masri (2016), Eq. 20.

The branch holds the signs: bit 0 is set where ẏ < 0, bit 1 where r < 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from data.annotations import NotNegative, Positive, Range
from data.checked import checked
from data.simulation.laws.compiling import inlined
from data.simulation.laws.element import Element


@inlined
def force(p, m, branch, y, ydot, z, work):  # p = A, β, γ, n, η, ν, dη/dwork, dν/dwork
    speed = -ydot if branch & 1 else ydot  # |ẏ| on this branch
    size = -z if branch & 2 else z  # |r| on this branch
    power = size if p[3] == 1.0 else max(size, 0.0) ** p[3]
    eta, nu = p[4] + p[6] * work, p[5] + p[7] * work
    loading = p[1] * speed * (-power if branch & 2 else power) - p[2] * ydot * power
    return z, (p[0] * ydot - nu * loading) / eta


@inlined
def margin(p, m, branch, y, ydot, z):
    if p[0] == 0.0:  # all its fibres are broken: no force, no branches
        return 1.0
    return min(-ydot if branch & 1 else ydot, -z if branch & 2 else z)


@inlined
def next_branch(p, m, branch, y, ydot, z):
    return (1 if ydot < 0.0 else 0) + (2 if z < 0.0 else 0), z, m


@checked
@dataclass(frozen=True, kw_only=True)
class BoucWen(Element):
    """Bouc–Wen hysteresis: ṙ = [A ẏ − ν (β |ẏ| |r|ⁿ⁻¹ r − γ ẏ |r|ⁿ)] / η (Eq. 20, printed sign).

    η and ν may grow with the energy E = ∫ r ẏ dt that the element took up, η = η₀ + η' E, and so
    degrade its stiffness and strength (Baber & Wen 1981). The paper has η' = ν' = 0.
    """

    fibres = ("stiffness",)
    stiffness: Positive  # A [N/m]
    beta: float  # β [N^(1−n)·1/m]
    gamma: float  # γ [N^(1−n)·1/m]
    exponent: Annotated[float, Range(1)] = 1.0  # n; below 1 no unique solution at r = 0
    eta: Positive = 1.0  # η₀
    nu: Positive = 1.0  # ν₀
    eta_rate: NotNegative = 0.0  # η' [1/J]
    nu_rate: NotNegative = 0.0  # ν' [1/J]

    def weakened(self, kept: float) -> tuple[float, ...]:
        # each fibre goes on under r / kept, so that β and γ, which multiply |r|ⁿ, change too
        A, beta, gamma, *rest = super().weakened(kept)
        factor = kept ** (1.0 - self.exponent) if kept > 0.0 else 0.0
        return A, factor * beta, factor * gamma, *rest

    def tangent(self) -> tuple[float, float]:
        return self.stiffness / self.eta, 0.0
