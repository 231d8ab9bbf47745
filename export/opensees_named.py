"""Named laws (data/simulation/elements) as stock materials of OpenSees, where they are the same.

Polynomial        Elastic, ElasticPowerFunc
MenegottoPinto    Steel02
SelfCentering     SelfCentering
SlackBrace        two ElasticPPGap with damage
FrictionPendulum  Elastic, ElasticPP, where friction does not depend on speed
BaberNoori        BoucWen, where it neither pinches nor is unsymmetric
Pinching4         Pinching4, also where its sides differ
Hysteretic        Hysteretic, likewise
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from data.simulation.elements import (
    BaberNoori,
    Element,
    FrictionPendulum,
    Hysteretic,
    MenegottoPinto,
    Pinching4,
    Polynomial,
    SelfCentering,
    SlackBrace,
    UnevenHysteretic,
    UnevenPinching4,
)
from data.simulation.elements.hysteretic import PLACES as THREE
from data.simulation.elements.pinching4 import LOSSES
from data.simulation.elements.pinching4 import PLACES as FOUR
from export.opensees_laws import Material

SAME = 1e-6  # share of a friction or stiffness that makes no difference


def named_materials(element: Element, name: str) -> list[Material]:
    """Materials in parallel that are an element's law. name: of the element, for messages.

    Raises ValueError for a law that no stock material is.
    """
    make = MADE.get(type(element))
    if make is None:
        raise ValueError(
            f"{name} follows {type(element).__name__}, which no stock material of OpenSees is; "
            "choose to=c or to=fmu"
        )
    try:
        return [Material([command]) for command in make(element)]
    except ValueError as error:
        raise ValueError(f"{name}: {error}; choose to=c or to=fmu") from None


Command = tuple[object, ...]


def _damper(damping: float) -> list[Command]:
    return [("Elastic", 0.0, damping)] if damping > 0.0 else []


def _polynomial(e: Polynomial) -> list[Command]:
    cubic = [("ElasticPowerFunc", "-coeff", e.cubic_stiffness, "-exp", 3.0)]
    return [("Elastic", e.stiffness, e.damping), *(cubic if e.cubic_stiffness != 0.0 else [])]


def _steel(e: MenegottoPinto) -> list[Command]:
    shape = (e.sharpness, e.sharpness_loss, e.loss_excursion, e.a1, e.a2, e.a3, e.a4)
    steel = ("Steel02", e.stiffness * e.yield_displacement, e.stiffness, e.hardening_ratio, *shape)
    return [steel, *_damper(e.damping)]


def _flag(e: SelfCentering) -> list[Command]:
    k, activation = e.stiffness, e.stiffness * e.activation_displacement
    return [("SelfCentering", k, e.hardening_ratio * k, activation, e.flag), *_damper(e.damping)]


def _slack(e: SlackBrace) -> list[Command]:
    k, force = e.stiffness, e.stiffness * e.yield_displacement
    braces = [
        ("ElasticPPGap", k, side * force, side * e.gap, e.hardening_ratio, "damage")
        for side in (1.0, -1.0)
    ]
    return [*braces, *_damper(e.damping)]


def _pendulum(e: FrictionPendulum) -> list[Command]:
    if e.friction_fast - e.friction_slow > SAME * e.friction_fast:
        raise ValueError("friction that grows with speed has no stock material between two nodes")
    if e.curvature > 0.0:
        raise ValueError("a curved surface (curvature) has no stock material between two nodes")
    slider = e.weight * e.friction_fast / e.yield_displacement
    return [
        ("Elastic", e.weight / e.radius, e.damping),
        ("ElasticPP", slider, e.yield_displacement),
    ]


def _bouc_wen(e: BaberNoori) -> list[Command]:
    if e.pinching > SAME or e.asymmetry != 0.0:
        raise ValueError("pinching and asymmetry of BaberNoori are not in OpenSees' BoucWen")
    smooth = (e.post_yield_ratio, e.stiffness, e.exponent, e.gamma, e.beta, 1.0)
    return [("BoucWen", *smooth, 0.0, e.nu_rate, e.eta_rate)]


def _four_points(e: Pinching4) -> list[Command]:
    points, shares = _points(e, FOUR), _pinching(e, "")
    if isinstance(e, UnevenPinching4):
        shares += _pinching(e, "back_")
        points += _points(e, FOUR, "back_", -1.0)
    losses = [getattr(e, name) for name in LOSSES]
    wall = ("Pinching4", *points, *shares, *losses, e.energy_capacity, "energy")
    return [wall, *_damper(e.damping)]


def _three_points(e: Hysteretic) -> list[Command]:
    back = "back_" if isinstance(e, UnevenHysteretic) else ""
    points = [*_points(e, THREE), *_points(e, THREE, back, -1.0)]
    damage = (e.growth_by_ductility, e.growth_by_energy, e.unloading_exponent)
    joint = ("Hysteretic", *points, e.reloading_place, e.reloading_force, *damage)
    return [joint, *_damper(e.damping)]


def _points(
    e: Pinching4 | Hysteretic, names: Sequence[str], back: str = "", side: float = 1.0
) -> list[float]:
    """Force [N] and place [m] of every point of a side."""
    first = getattr(e, f"{back}strength_1") if back else 1.0
    strengths = [first, *(getattr(e, f"{back}strength_{i + 1}") for i in range(1, len(names)))]
    places, force = [getattr(e, f"{back}{n}") for n in names], e.stiffness * e.yield_displacement
    return [side * n for s, y in zip(strengths, places, strict=True) for n in (force * s, y)]


def _pinching(e: Pinching4, back: str) -> list[float]:
    named = ("reloading_place", "reloading_force", "unloading_force")
    return [getattr(e, f"{back}{name}") for name in named]


MADE: dict[type[Element], Callable[..., list[Command]]] = {
    Polynomial: _polynomial,
    MenegottoPinto: _steel,
    SelfCentering: _flag,
    SlackBrace: _slack,
    FrictionPendulum: _pendulum,
    BaberNoori: _bouc_wen,
    Pinching4: _four_points,
    UnevenPinching4: _four_points,
    Hysteretic: _three_points,
    UnevenHysteretic: _three_points,
}
