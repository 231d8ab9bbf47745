"""What is known of a simulated structure, under the names of an identified model's parameters."""

from __future__ import annotations

import re
from collections.abc import Sequence

from torch import Tensor

from data.record import Truth
from data.simulation.structure import SUPPORT, Structure
from models.estimator import Estimator

SAME = (  # of elements in data/simulation/laws and of models
    *("stiffness", "damping", "yield_displacement", "activation_displacement"),
    *("post_yield_stiffness", "cubic_stiffness", "hardening_ratio", "gap"),
)


def truth_of(structure: Structure, estimator: Estimator) -> dict[str, float]:
    """{name: value} of what a structure has alone between two nodes; {} of other estimators.

    Elements that the structure lacks have no stiffness and no damping.
    """
    if estimator.elements is None or estimator.dofs != structure.dofs:
        return {}
    known = {f"x{i}.mass": float(m) for i, m in enumerate(structure.masses, start=1)}
    between: dict[frozenset[str], list[object]] = {}
    for element in structure.elements.values():
        between.setdefault(_pair(element.between, estimator.supports), []).append(element)
    for e, pair in enumerate(estimator.elements, start=1):
        elements = between.get(_pair(pair, estimator.supports), [])
        if not elements:
            known |= {f"r{e}.stiffness": 0.0, f"r{e}.damping": 0.0}
        elif len(elements) == 1:
            known |= _of_element(elements[0], f"r{e}")
    return known


def forces_of(structure: Structure, estimator: Estimator, truth: Truth) -> Tensor | None:
    """True forces (…, T, E) [N] in the elements of a model; None where the pairs are others."""
    names, supports = list(structure.elements.values()), estimator.supports
    assert estimator.elements is not None
    total = truth.r.new_zeros(*truth.r.shape[:-1], len(estimator.elements))
    places = {_pair(pair, supports): e for e, pair in enumerate(estimator.elements)}
    for i, element in enumerate(names):
        e = places.get(_pair(element.between, supports))
        if e is None:
            return None
        same = _ends(element.between, supports) == _ends(estimator.elements[e], supports)
        total[..., e] += truth.r[..., i] if same else -truth.r[..., i]
    return total


def _pair(nodes: Sequence[str], supports: int) -> frozenset[str]:
    """The two nodes; supports that do not move are ground."""
    return frozenset(_ends(nodes, supports))


def _ends(nodes: Sequence[str], supports: int) -> tuple[str, ...]:
    fixed = "s1" if supports else "ground"
    found = ((fixed if not supports and re.fullmatch(SUPPORT, n) else n) for n in nodes)
    return tuple(fixed if n == "ground" and supports == 1 else n for n in found)


def _of_element(element: object, part: str) -> dict[str, float]:
    found = {f"{part}.{q}": float(getattr(element, q)) for q in SAME if hasattr(element, q)}
    first, last = (found.get(f"{part}.{q}") for q in ("stiffness", "post_yield_stiffness"))
    if first and last is not None:
        found[f"{part}.post_yield_ratio"] = last / first
    return found
