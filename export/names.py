"""Names and units of what goes into a model and comes out of it, as programs can spell them."""

from __future__ import annotations

import re

from models.estimator import Estimator

MOTION = (("x", "m"), ("v", "m/s"), ("a", "m/s2"))


def inputs_of(model: Estimator) -> list[tuple[str, str]]:
    """Name and unit of every excitation (m,): forces, displacements and velocities of supports.

    Where a model does not know which is which, all are called u, of unknown unit.
    """
    forces, supports = getattr(model, "forces", None), getattr(model, "supports", None)
    if isinstance(forces, int) and isinstance(supports, int):
        unit = "m/s2" if getattr(model, "base", False) else "N"
        named = [(f"f{i + 1}", unit) for i in range(forces)]
        named += [(f"s{i + 1}", "m") for i in range(supports)]
        return named + [(f"s_dot{i + 1}", "m/s") for i in range(supports)]
    return [(f"u{i + 1}", "") for i in range(model.inputs)]


def motion_of(model: Estimator) -> list[tuple[str, list[str], str]]:
    """The outputs x, v, a (n,) of a motion."""
    numbers = range(1, model.dofs + 1)
    return [(name, [f"{name}{i}" for i in numbers], unit) for name, unit in MOTION]


def elements_of(model: Estimator, count: int) -> list[str]:
    """A name for every element: the nodes that it joins, where the model knows them."""
    pairs = getattr(model, "elements", None)
    if isinstance(pairs, list) and len(pairs) == count:
        return [spelled("_".join(map(str, pair))) for pair in pairs]
    return [f"e{i + 1}" for i in range(count)]


def spelled(name: str) -> str:
    """A name of letters, digits and underscores that does not begin with a digit."""
    word = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_") or "model"
    return f"m_{word}" if word[0].isdigit() else word
