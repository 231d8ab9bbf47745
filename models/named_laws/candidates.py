"""The named laws as functions of free numbers: what each may be, and where a search begins.

A law is simulated by its element (data/simulation/laws), with a spring in parallel where it has
none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

from data.simulation.laws.baber_noori import BaberNoori
from data.simulation.laws.element import Element
from data.simulation.laws.friction_pendulum import FrictionPendulum
from data.simulation.laws.menegotto_pinto import MenegottoPinto
from data.simulation.laws.polynomial import Polynomial
from data.simulation.laws.self_centering import SelfCentering
from data.simulation.laws.slack_brace import SlackBrace
from data.simulation.laws.takeda import Takeda
from models.named_laws.candidate import (
    DAMPING,
    PER_ENERGY,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Values,
    share,
)
from models.named_laws.four_points import FOUR_POINTS, UNEVEN_FOUR_POINTS
from models.named_laws.three_points import THREE_POINTS, UNEVEN_THREE_POINTS

SOFT = Parameter(0.02, 0.5, lambda units: units.force / units.length)
PINCHING = {
    "pinching": share(0.3, 0.9),
    "pinching_place": share(0.05, 0.3),
    "pinching_width": Parameter(0.03, 1.0, lambda units: units.elastic),
    "pinching_lambda": Parameter(0.05, 0.5),
}


def _plain(law: type[Element]) -> Callable[[Values, Sequence[str]], list[Element]]:
    """An element whose parameters are those of the candidate, by the same names."""
    known = {field.name for field in fields(law)}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        own = {name: value for name, value in values.items() if name in known}
        elements: list[Element] = [law(between=between, **own)]
        if "spring" in values:
            elements.append(Polynomial(between=between, stiffness=values["spring"]))
        return elements

    return made


def _steel(values: Values, between: Sequence[str]) -> list[Element]:
    """uneven: how many times as much the yield line grows in compression as in tension."""
    uneven = values.get("uneven", 1.0) ** 0.5
    growth = {"a1": values["growth"] * uneven, "a3": values["growth"] / uneven}
    own = {name: value for name, value in values.items() if name not in ("growth", "uneven")}
    return [MenegottoPinto(between=between, **own, **growth)]


def _pendulum(values: Values, between: Sequence[str]) -> list[Element]:
    """By forces: the weight is one, so that friction and curvature are what they do."""
    slow, fast = values["slow"], values["slow"] + values["faster"]
    bearing = FrictionPendulum(
        between=between,
        weight=1.0,
        radius=1.0 / values["stiffness"],
        friction_fast=fast,
        friction_slow=slow,
        rate=values["rate"],
        yield_displacement=values["yield_displacement"],
        damping=values["damping"],
        spring_share=values.get("spring_share", 0.0),
        curvature=values.get("curvature", 0.0),
    )
    return [bearing]


def _bouc_wen(values: Values, between: Sequence[str]) -> list[Element]:
    """By the largest z: β + γ ± 2 φ = z⁻ⁿ; of β + γ, β has a share above a half.

    uneven: how many times as large as backward z grows forward.
    """
    exponent, uneven = 1.0 + values["above_one"], values.get("uneven", 1.0) ** 0.5
    forward, backward = ((values["largest"] * u) ** -exponent for u in (uneven, 1.0 / uneven))
    bend = 0.5 * (forward + backward)
    beta = bend * (0.5 + 0.5 * values["beta_share"])
    own = {name: values[name] for name in ("stiffness", "post_yield_ratio")}
    degrading = {name: v for name, v in values.items() if name in (*PER_ENERGY, *PINCHING)}
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


_SMOOTH = {
    "stiffness": STIFFNESS,
    "post_yield_ratio": share(0.02, 0.3),
    "largest": YIELD,
    "beta_share": share(0.2, 0.9),
    "above_one": Parameter(0.05, 1.0),  # of the exponent
    "damping": DAMPING,
}
STEEL_PARAMETERS = {
    "yield_displacement": YIELD,
    "stiffness": STIFFNESS,
    "hardening_ratio": share(0.01, 0.2),
    "sharpness": Parameter(5.0, 25.0),
    "sharpness_loss": share(0.8, 0.95),
    "loss_excursion": Parameter(0.05, 0.3),
    "growth": Parameter(0.003, 0.1),
    "damping": DAMPING,
}
PENDULUM_SIZES = ("stiffness", "slow", "faster")
PENDULUM_PARAMETERS = {
    "stiffness": Parameter(0.1, 1.0, lambda units: units.force / units.length),
    "slow": Parameter(0.05, 0.5, lambda units: units.force),
    "faster": Parameter(0.02, 0.5, lambda units: units.force),
    "rate": Parameter(0.3, 3.0, lambda units: 1.0 / units.rate),
    "yield_displacement": Parameter(0.05, 1.0, lambda units: units.elastic),
    "damping": DAMPING,
}
CURVED_PENDULUM = Candidate(
    "CurvedFrictionPendulum",
    PENDULUM_PARAMETERS
    | {
        "spring_share": Parameter(0.1, 0.9, from_zero=True),
        "curvature": Parameter(  # its radius is twice the largest deformation at least
            0.1, 0.5, lambda units: 0.5 / units.length, from_zero=True
        ),
    },
    _pendulum,
    PENDULUM_SIZES,
)
_DEGRADING = {**_SMOOTH, **PER_ENERGY, **PINCHING}
_UNEVEN = {"uneven": Parameter(0.9, 1.1)}
UNEVEN_BOUC_WEN = Candidate("UnevenBoucWen", {**_SMOOTH, **_UNEVEN}, _bouc_wen)
UNEVEN_BABER_NOORI = Candidate("UnevenBaberNoori", {**_DEGRADING, **_UNEVEN}, _bouc_wen)
UNEVEN_STEEL = Candidate("UnevenMenegottoPinto", {**STEEL_PARAMETERS, **_UNEVEN}, _steel)
STEEL = Candidate("MenegottoPinto", STEEL_PARAMETERS, _steel, uneven=UNEVEN_STEEL)
CANDIDATES = {
    candidate.name: candidate
    for candidate in (
        Candidate(
            "SelfCentering",
            {
                "activation_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": share(0.01, 0.3),
                "flag": share(0.3, 0.95),
                "damping": DAMPING,
            },
            _plain(SelfCentering),
        ),
        Candidate(
            "Takeda",
            {
                "yield_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": share(0.01, 0.3),
                "unloading_exponent": share(0.1, 0.6),
                "damping": DAMPING,
            },
            _plain(Takeda),
        ),
        Candidate(
            "SlackBrace",
            {
                "yield_displacement": YIELD,
                "stiffness": STIFFNESS,
                "hardening_ratio": share(0.01, 0.3),
                "gap": Parameter(0.01, 0.2, lambda units: units.length),
                "damping": DAMPING,
                "spring": SOFT,
            },
            _plain(SlackBrace),
        ),
        Candidate(
            "FrictionPendulum",
            PENDULUM_PARAMETERS,
            _pendulum,
            PENDULUM_SIZES,
            uneven=CURVED_PENDULUM,
        ),
        Candidate("BoucWen", _SMOOTH, _bouc_wen, uneven=UNEVEN_BOUC_WEN),
        STEEL,
        Candidate("BaberNoori", _DEGRADING, _bouc_wen, uneven=UNEVEN_BABER_NOORI),
        FOUR_POINTS,
        Candidate(
            "Linear", {"stiffness": STIFFNESS, "damping": DAMPING}, _plain(Polynomial)
        ),  # a storey that stays elastic would show nothing of a law's yielding
        UNEVEN_STEEL,
        UNEVEN_FOUR_POINTS,
        THREE_POINTS,
        UNEVEN_THREE_POINTS,
        UNEVEN_BOUC_WEN,
        UNEVEN_BABER_NOORI,
        CURVED_PENDULUM,
    )
}
