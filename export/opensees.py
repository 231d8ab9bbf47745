"""An element network as a script for OpenSeesPy, with stock materials alone.

The pip package of OpenSees takes no materials of one's own. Each term of an element's law becomes
a stock material (of a named law its own `opensees`), `Parallel` joins them between two nodes, and
the equation of motion is solved by OpenSees' explicit Newmark method, which needs no iterations:
its steps are a fraction of the model's own, so it is stable where the model is. Of a learned law
(models/composition/laws.py):

    k y + c ẏ                 Elastic, with the stiffness Σ w of the units taken off
    hinges                    ElasticMultiLinear
    k₃ y³                     ElasticPowerFunc
    w z, b = 0                ElasticPP
    w z, no limit in reach    BoucWen, n = 1, γ = (b₋ − b₊)/2, β = −(b₊ + b₋)/2
    w z, b and a limit        BoucWen in Series with an ElasticPP slider, which caps its force

The law of z knows increments of y alone. So a slider in series, which takes up what goes beyond the
limit, leaves z as it is there: the same law, except for the slider's flexibility 1/K. With

    k₀ (1 − k₀/K) = 1,   b' (1 − 2 k₀/K) = b

both in series have the tangent 1 + b z to O((b z)²/K). L columns of coefficients of a law.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import Template

import numpy as np
import torch
from torch import Tensor

from data.simulation.laws.element import Element
from export.names import python_comment
from export.run import Exported
from models.composition.laws import LINEAR
from models.composition.laws_compiled import unit_step
from models.element_network import ElementNetwork

SCRIPT = Path(__file__).with_name("opensees_script.py.txt")
NOTHING = 1e-4  # of an element's largest elastic force in training: a unit of less is left out
STRAIGHT = 1e-5  # of a unit's largest force: what b may add where it is left out
STIFF = 200.0  # K, over the unit's stiffness; Series loses its way with much more
FAR = 2.0  # times the largest deformation of training: a limit out of reach beyond


@dataclass(frozen=True)
class Material:
    """`factor` times a material. parts: the commands that make it, the last of which it is.

    "@-1" in a command represents the tag of the command before, "@-2" of the one before that.
    """

    parts: Sequence[tuple[object, ...]]
    factor: float = 1.0
    notes: Sequence[str] = ()


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
    names = [f"x{i + 1}" for i in range(network.floors)]
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


def material_of(law: Tensor, counts: tuple[int, int], largest: float | None) -> list[Material]:
    """Materials in parallel that are the law with coefficients (L,).

    largest: deformation [m] in training, where it is known.
    """
    k, c, cubic = law[:LINEAR].tolist()
    a = LINEAR + 2 * counts[0]
    units_of = law[a:].reshape(-1, 4).tolist()
    found = [Material([("Elastic", k - sum(w for w, *_ in units_of), c)])]
    found += _many_lines(law[LINEAR:a].reshape(-1, 2))
    if cubic != 0.0:
        found.append(Material([("ElasticPowerFunc", "-coeff", cubic, "-exp", 3.0)]))
    least = 0.0 if largest is None else NOTHING * abs(k) * largest
    weak = [abs(w) * limit for w, limit, *_ in units_of if 0.0 < abs(w) * limit <= least]
    if weak:
        note = f"{len(weak)} units are left out, of {max(weak):.2g} N at most"
        found[0] = replace(found[0], notes=[note])
    kept = [u for u in units_of if abs(u[0]) * u[1] > least]
    return found + [_unit(w, limit, up, down, largest) for w, limit, up, down in kept]


def _many_lines(hinges: Tensor) -> list[Material]:
    """Hinges (H, 2) as one line of straight pieces."""
    hinges = hinges[hinges[:, 0] != 0.0]
    if len(hinges) == 0:
        return []
    right = np.unique(np.array([gap for _, gap in hinges.tolist()]))
    right = right[right > 0.0]
    y = np.concatenate([[-right[-1] - 1.0], -right[::-1], [0.0], right, [right[-1] + 1.0]])
    r = np.zeros_like(y)
    for g, gap in hinges.tolist():
        r += g * np.clip(np.abs(y) - gap, 0.0, None) * np.sign(y)
    words = ("ElasticMultiLinear", "-strain", *y.tolist(), "-stress", *r.tolist())
    return [Material([words], 1.0)]


def _unit(w: float, limit: float, rising: float, falling: float, largest: float | None) -> Material:
    """w z of a hysteretic unit."""
    bend = max(abs(rising), abs(falling))
    if bend * limit <= STRAIGHT:
        return Material([("ElasticPP", 1.0, limit)], w)
    if _capless(limit, rising, falling):
        return Material([_smooth(1.0, rising, falling)], w)
    if largest is not None and _reached(rising, falling, FAR * largest) < limit:
        note = f"the limit {limit:.3g} m of z is omitted: {FAR * largest:.3g} m do not reach it"
        return Material([_smooth(1.0, rising, falling)], w, [note])
    stiffness = 0.5 * STIFF * (1.0 - math.sqrt(1.0 - 4.0 / STIFF))
    more = 1.0 / (1.0 - 2.0 * stiffness / STIFF)
    smooth = _smooth(stiffness, more * rising, more * falling)
    slider = ("ElasticPP", STIFF, limit / STIFF)
    return Material([smooth, slider, ("Series", "@-2", "@-1")], w)


def _smooth(stiffness: float, rising: float, falling: float) -> tuple[object, ...]:
    gamma, beta = 0.5 * (falling - rising), -0.5 * (rising + falling)
    return ("BoucWen", 0.0, stiffness, 1.0, gamma, beta, 1.0, 0.0, 0.0, 0.0)


def _capless(limit: float, rising: float, falling: float) -> bool:
    """Whether z ends at −1/b₊, below the limit, and comes back from there."""
    return rising < 0.0 and -1.0 / rising <= limit and falling < -rising


def _reached(rising: float, falling: float, amplitude: float) -> float:
    """The largest |z| [m] of a unit without a limit in 20 cycles of an amplitude [m]."""
    z, most = 0.0, 0.0
    for way in [amplitude, *([-2.0 * amplitude, 2.0 * amplitude] * 20)]:
        z = unit_step(z, way, math.inf, rising, falling)[0]
        if math.isnan(z):
            return math.inf
        most = max(most, abs(z))
    return most
