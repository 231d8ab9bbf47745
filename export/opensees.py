"""An element network as a script for OpenSeesPy, with stock materials alone.

The pip package of OpenSees takes no materials of one's own. Each term of an element's law becomes
a stock material (export/opensees_laws.py, of a named law its own `opensees`), `Parallel`
joins them between two nodes, and the equation of motion is solved by OpenSees' explicit
Newmark method, which needs no iterations: its steps are a fraction of the model's own, so it is
stable where the model is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template

import torch

from data.simulation.laws.element import Element
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
        absolute=model.absolute,
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


def named_materials(element: Element, name: str) -> list[Material]:
    """Materials in parallel that are an element's law. name: of the element, for messages.

    Raises ValueError for a law that no stock material is.
    """
    try:
        return [Material([command]) for command in element.opensees()]
    except ValueError as error:
        raise ValueError(f"{name}: {error}; choose to=c or to=fmu") from None
