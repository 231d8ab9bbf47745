"""Generalised Bouc–Wen hysteresis: unsymmetric, degrading, pinching.

    r = α k y + (1 − α) k z
    ż = h(z) ẏ {1 − ν |z|ⁿ [β sgn(ẏ z) + γ + φ (sgn ẏ + sgn z)]} / η
    h = 1 − ζ₁ exp(−(z sgn ẏ − q z_u)² / ζ₂²),   z_u = [1 / (ν (β + γ + 2 φ sgn ẏ))]^(1/n)
    η = 1 + η' E,   ν = 1 + ν' E,   ζ₁ = ζ (1 − exp(−p E)),   ζ₂ = (ψ + δ E) (λ + ζ₁)

E = (1 − α) k ∫ z ẏ dt is the work on the hysteretic part [J], that on the element less ½ α k y².
η' softens, ν' weakens, h pinches; φ > 0 makes the element weaker forward than backward.

Baber & Wen (1981), J. Eng. Mech. ASCE 107, 1069–1087 (η, ν); Baber & Noori (1985), J. Eng. Mech.
ASCE 111, 1010–1026, and Foliente (1995), J. Struct. Eng. ASCE 121, 1013–1022 (h); Wang & Wen
(2000), Struct. Dyn. 29, 999–1016 (φ). The branch holds signs: bit 0 where ẏ < 0, bit 1 where z < 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

from data.annotations import Fraction, NotNegative, Positive, Range
from data.checked import checked
from data.simulation.laws.bouc_wen import next_branch as next_branch
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
from data.simulation.laws.element import SAME, Command, Element
from data.simulation.laws.polynomial import Polynomial


@inlined
def _pinch(p, way, z, nu, limit, energy):
    """h(z) of an element that moves in direction `way`."""
    loss = p[8] * (1.0 - math.exp(-p[9] * energy))
    width = (p[11] + p[12] * energy) * (p[13] + loss)
    ultimate = (1.0 / (nu * limit)) ** (1.0 / p[5])
    return 1.0 - loss * math.exp(-(((z * way - p[10] * ultimate) / width) ** 2))


@inlined
def force(p, m, branch, y, ydot, z, work):
    # p = k, α, β, γ, φ, n, η', ν', ζ, p, q, ψ, δ, λ
    k, alpha = p[0], p[1]
    way, pull = (-1.0 if branch & 1 else 1.0), (-1.0 if branch & 2 else 1.0)
    energy = max(0.0, work - 0.5 * alpha * k * y * y)
    eta, nu = 1.0 + p[6] * energy, 1.0 + p[7] * energy
    bend = p[2] * way * pull + p[3] + p[4] * (way + pull)
    zdot = ydot * (1.0 - nu * max(pull * z, 0.0) ** p[5] * bend) / eta
    if p[8] > 0.0:
        limit = p[2] + p[3] + 2.0 * p[4] * way
        zdot *= _pinch(p, way, z, nu, limit, energy)
    return k * (alpha * y + (1.0 - alpha) * z), zdot


@inlined
def margin(p, m, branch, y, ydot, z):
    return min(-ydot if branch & 1 else ydot, -z if branch & 2 else z)


@checked
@dataclass(frozen=True, kw_only=True)
class BaberNoori(Element):
    """Generalised Bouc–Wen: r = α k y + (1 − α) k z, with degradation, pinching, asymmetry.

    ż = h(z) ẏ {1 − ν |z|ⁿ [β sgn(ẏ z) + γ + φ (sgn ẏ + sgn z)]} / η, z in metres; the largest z is
    (β + γ ± 2 φ)^(−1/n) before degradation. η, ν and h change with the energy E that the hysteretic
    part took up. Raises ValueError for parameters out of range, and unless |γ| ≤ β and
    β + γ > 2 |φ|: other elements make energy or have no largest force.
    """

    fibres = ("stiffness",)
    stiffness: Positive  # k [N/m]
    post_yield_ratio: Fraction = 0.0  # α
    beta: Positive  # β [m⁻ⁿ]
    gamma: float  # γ [m⁻ⁿ]
    asymmetry: float = 0.0  # φ [m⁻ⁿ]
    exponent: Annotated[float, Range(1)] = 1.0  # n
    eta_rate: NotNegative = 0.0  # η' [1/J], loss of stiffness
    nu_rate: NotNegative = 0.0  # ν' [1/J], loss of strength
    pinching: Fraction = 0.0  # ζ, loss of stiffness where it pinches most, in [0, 1)
    pinching_rate: NotNegative = 0.0  # p [1/J]
    pinching_place: NotNegative = 0.0  # q, z over its largest value where it pinches most
    pinching_width: Positive = 1.0  # ψ [m]
    pinching_spread: NotNegative = 0.0  # δ [m/J]
    pinching_lambda: Positive = 1.0  # λ

    def __post_init__(self) -> None:
        super().__post_init__()
        if abs(self.gamma) > self.beta or self.beta + self.gamma <= 2.0 * abs(self.asymmetry):
            raise ValueError(
                f"BaberNoori.beta={self.beta}, gamma={self.gamma}, asymmetry={self.asymmetry}: "
                "expected |gamma| ≤ beta and 2 |asymmetry| < beta + gamma"
            )

    def strengths(self) -> tuple[float, float] | None:
        if self.asymmetry == 0.0:
            return None
        bend, k = self.beta + self.gamma, (1.0 - self.post_yield_ratio) * self.stiffness
        forward, backward = (bend + side * self.asymmetry for side in (2.0, -2.0))
        power = -1.0 / self.exponent
        return k * forward**power, k * backward**power

    def tangent(self) -> tuple[float, float]:
        return self.stiffness, 0.0

    def opensees(self) -> list[Command]:
        if self.pinching > SAME or self.asymmetry != 0.0:
            raise ValueError("pinching and asymmetry of BaberNoori are not in OpenSees' BoucWen")
        smooth = (self.post_yield_ratio, self.stiffness, self.exponent, self.gamma, self.beta, 1.0)
        return [("BoucWen", *smooth, 0.0, self.nu_rate, self.eta_rate)]


def _smooth(values: Values, between: Sequence[str]) -> list[Element]:
    """By the largest z: β + γ ± 2 φ = z⁻ⁿ; of β + γ, β has a share above a half.

    uneven: how many times as large as backward z grows forward.
    """
    exponent, uneven = 1.0 + values["above_one"], values.get("uneven", 1.0) ** 0.5
    forward, backward = ((values["largest"] * u) ** -exponent for u in (uneven, 1.0 / uneven))
    bend = 0.5 * (forward + backward)
    beta = bend * (0.5 + 0.5 * values["beta_share"])
    own = {name: values[name] for name in ("stiffness", "post_yield_ratio")}
    degrading = {name: v for name, v in values.items() if name in _DEGRADING}
    law = BaberNoori(
        between=between,
        beta=beta,
        gamma=bend - beta,
        asymmetry=0.25 * (forward - backward),
        exponent=exponent,
        **own,
        **degrading,
    )
    return [law, Polynomial(between=between, stiffness=0.0, damping=values["damping"])]


def _per_work(low: float, high: float) -> Parameter:
    return Parameter(
        low, high, lambda units: 1.0 / (units.force * units.length), symbol="1/J", per_energy=True
    )


_PARAMETERS = {
    "stiffness": STIFFNESS,
    "post_yield_ratio": share(0.02, 0.3),
    "largest": replace(YIELD, word="largest_hysteretic_displacement"),
    "beta_share": share(0.2, 0.9),
    "above_one": Parameter(0.05, 1.0, word="exponent_less_one"),
    "damping": DAMPING,
}
_DEGRADING = {
    "eta_rate": _per_work(1e-3, 0.1),
    "nu_rate": _per_work(1e-3, 0.1),
    "pinching_rate": _per_work(0.03, 1.0),
    "pinching_spread": Parameter(
        1e-4, 1e-2, lambda units: 1.0 / units.force, symbol="m/J", per_energy=True
    ),
    "pinching": share(0.3, 0.9),
    "pinching_place": share(0.05, 0.3),
    "pinching_width": Parameter(0.03, 1.0, lambda units: units.elastic, symbol="m"),
    "pinching_lambda": Parameter(0.05, 0.5),
}
_UNEVEN = {"uneven": Parameter(0.9, 1.1)}
_BOUC_WEN, _UNEVEN_BOUC_WEN = Candidate(
    "BoucWen", _PARAMETERS, _smooth, number=4, yields="largest"
).widened("UnevenBoucWen", 13, _UNEVEN)
_BABER_NOORI, _UNEVEN_BABER_NOORI = Candidate(
    "BaberNoori", _PARAMETERS | _DEGRADING, _smooth, number=6, yields="largest", paired=True
).widened("UnevenBaberNoori", 14, _UNEVEN)
CANDIDATES = (_BOUC_WEN, _BABER_NOORI, _UNEVEN_BOUC_WEN, _UNEVEN_BABER_NOORI)
