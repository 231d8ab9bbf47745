"""An element network as a script for OpenSeesPy, with stock materials alone.

The pip package of OpenSees takes no materials of one's own. Each term of an element's law becomes
a stock material (export/opensees_laws.py, for named laws export/opensees.py), `Parallel`
joins them between two nodes, and the equation of motion is left to OpenSees' explicit
Newmark method, which needs no iterations: its steps are a fraction of the model's own, so it is
stable where the model is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import torch

from data.simulation.laws.baber_noori import BaberNoori
from data.simulation.laws.element import Element
from data.simulation.laws.friction_pendulum import FrictionPendulum
from data.simulation.laws.hysteretic import PLACES as THREE
from data.simulation.laws.hysteretic import Hysteretic, UnevenHysteretic
from data.simulation.laws.menegotto_pinto import MenegottoPinto
from data.simulation.laws.pinching4 import LOSSES, Pinching4, UnevenPinching4
from data.simulation.laws.pinching4 import PLACES as FOUR
from data.simulation.laws.polynomial import Polynomial
from data.simulation.laws.self_centering import SelfCentering
from data.simulation.laws.slack_brace import SlackBrace
from export.names import python_comment
from export.opensees_laws import Material, material_of
from export.run import Exported
from models.element_network import ElementNetwork

SCRIPT = Path(__file__).with_name("opensees_script.py.txt")


@dataclass(frozen=True)
class Joined:
    """An element: the nodes it runs from and to, its name and its materials side by side."""

    name: str
    first: str
    second: str
    materials: Sequence[Material]


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME_opensees.py. Raises ValueError for a model that stock materials cannot make."""
    path = folder / f"{model.name}_opensees.py"
    path.write_text(script_of(model), encoding="utf-8")
    return [path]


def script_of(model: Exported) -> str:
    """The text of the script. Raises ValueError for a model that stock materials cannot make."""
    network = model.estimator
    if not isinstance(network, ElementNetwork) or network.laws_are_curves:
        raise ValueError(
            f"{type(network).__name__} is no network of elements that stock materials can make; "
            "choose to=c or to=fmu"
        )
    if any(len(nodes) > 2 for nodes in network.elements):
        raise ValueError(
            "an element that bends joins three nodes, which no stock material does; choose to=c or "
            "to=fmu"
        )
    elements = joined_elements(network, model)
    notes = [f"{e.name}: {note}" for e in elements for m in e.materials for note in m.notes]
    told = [*model.lines(), "", *(notes or ["every term of every law is here"])]
    text = Template(SCRIPT.read_text("utf-8"))
    return text.substitute(
        name=model.name,
        about=python_comment(told),
        masses=_listed(f"{mass!r}" for mass in network.mass().detach().tolist()),
        supports=network.supports,
        forced=[i + 1 for i in network.forced],
        base=network.base,
        columns=[name for name, _ in model.plain_inputs],
        units=", ".join(f"{name} [{unit}]" for name, unit in model.plain_inputs),
        dt=repr(network.dt),
        steps=5 * network.substeps,
        elements=_listed(_element(e) for e in elements),
    )


def joined_elements(network: ElementNetwork, model: Exported) -> list[Joined]:
    """The elements of a network, each from its first node to its second."""
    ranges = model.passport.facts["trained_range"].get("deformation", {}).get("largest")
    largest = ranges if ranges and len(ranges) == len(network.elements) else None
    composition = network.composition()
    laws, found = composition.laws.value.detach(), []
    for e, pair in enumerate(network.elements):
        name = "–".join(pair)
        if (parts := network.named_elements(e)) is not None:
            materials = [one for part in parts for one in named_materials(part, name)]
        else:
            most = None if largest is None else float(largest[e])
            materials = material_of(laws[e], composition.counts, most)
        found.append(Joined(name, *_ends(network, e), materials))
    for name, damper in network.mass_dampers().items():
        foot, mass = damper.between
        found.append(Joined(name, foot, mass, named_materials(damper, name)))
    return found


def _ends(network: ElementNetwork, e: int) -> tuple[str, str]:
    """The nodes between which y = second − first."""
    row = torch.cat([network.B[e], network.B_s[e]]).tolist()
    names = [f"x{i + 1}" for i in range(network.dofs)]
    names += [f"s{i + 1}" for i in range(network.supports)]
    first = [name for name, sign in zip(names, row, strict=True) if sign < 0.0]
    second = [name for name, sign in zip(names, row, strict=True) if sign > 0.0]
    return (first or ["ground"])[0], (second or ["ground"])[0]


def _element(element: Joined) -> str:
    rows = ",\n        ".join(repr((m.factor, list(m.parts))) for m in element.materials)
    return f"({element.first!r}, {element.second!r}, [\n        {rows},\n    ])"


def _listed(rows: object) -> str:
    return "".join(f"    {row},\n" for row in rows)  # type: ignore[attr-defined]


# Named laws (data/simulation/laws) as stock materials of OpenSees, where they are the same.
#
# Polynomial        Elastic, ElasticPowerFunc
# MenegottoPinto    Steel02
# SelfCentering     SelfCentering
# SlackBrace        two ElasticPPGap with damage
# FrictionPendulum  Elastic, ElasticPP, where friction does not depend on speed
# BaberNoori        BoucWen, where it neither pinches nor is unsymmetric
# Pinching4         Pinching4, also where its sides differ
# Hysteretic        Hysteretic, likewise

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
