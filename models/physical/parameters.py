"""Physical parameters of one element, by the kind of its law: springs, dampers, yield, gaps.

Names have the form part.quantity or part.term.quantity: x1.mass, r2.stiffness,
r2.unit_1.yield_displacement. Parts: DOFs x1, …, elements r1, …, modes mode_1, …, the structure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

import torch
from torch import Tensor

from data.record import Truth
from data.simulation.structure import SUPPORT, Structure
from models.composition.coefficients import Coefficients
from models.composition.laws import GROUPS, NAMED, ElementLaws
from models.estimator import Estimator, Parameter

SMALL = 0.05  # of an element's stiffness: hinges and units that are told term by term alone


def numbers_of(laws: ElementLaws) -> dict[str, tuple[list[Any], list[bool]]]:
    """Of each kind of coefficient the values of all elements, and which elements have it at all."""
    found = {}
    for name, c in laws.named_children():
        if isinstance(c, Coefficients):
            value = c()
            there, some = (t[..., None].flatten(1).any(1) for t in (c.unit, value))
            found[name] = value.tolist(), (there & (some | c.learned)).tolist()
    return found


def composed_laws(
    laws: Mapping[str, tuple[list[Any], list[bool]]], e: int, part: str, about: str
) -> Iterator[Parameter]:
    """Of element e: stiffness and damping of small motions, gaps, hysteretic units by their limits.

    laws: of `numbers_of`. A unit bears its stiffness up to its yield displacement, then its yield
    force; `rising` and `falling` bend its way there (models/composition/laws.py): with `rising`
    b < 0 it tends to 1/|b| where that is nearer: it yields there. Once all have yielded, an element
    has its post-yield stiffness, springs beyond gaps aside. Its own gap, yield displacement and
    yield force are those of its stiffest hinge and unit, where they are no small part of it.
    """
    own = {name: values[e] for name, (values, _) in laws.items()}
    acts = {name: which[e] for name, (_, which) in laws.items()}
    for attribute, name, unit in NAMED:
        if acts[attribute]:
            yield Parameter(f"{part}.{name}", own[attribute], unit, about)
    for group, all_columns in GROUPS:
        columns = [c for c in all_columns if acts[c[0]]]
        rows = sorted(zip(*(own[attribute] for attribute, *_ in columns), strict=True))
        for i, row in enumerate(rows, start=1):
            for value, (_, name, unit) in zip(row, columns, strict=True):
                yield Parameter(f"{part}.{group}_{i}.{name}", value, unit, about)
            if group == "unit":
                yields_at = yield_point(row[0], row[2] if len(row) > 2 else 0.0)
                yield Parameter(
                    f"{part}.unit_{i}.yield_force", yields_at * row[1], "N", about, derived=True
                )
    k = own["stiffness"]
    if gap := _main(own["hinge_stiffness"], own["hinge_gap"], k):
        yield Parameter(f"{part}.gap", gap, "m", about, derived=True)
    if own["unit_stiffness"]:
        left = k - sum(own["unit_stiffness"])
        yield Parameter(f"{part}.post_yield_stiffness", left, "N/m", about, derived=True)
        if k > 0.0:
            yield Parameter(f"{part}.post_yield_ratio", left / k, "", about, derived=True)
        places = list(map(yield_point, own["unit_limit"], own["unit_rising"]))
        if place := _main(own["unit_stiffness"], places, k):
            yield Parameter(f"{part}.yield_displacement", place, "m", about, derived=True)
            yield Parameter(f"{part}.yield_force", k * place, "N", about, derived=True)


def yield_point(limit: float, rising: float) -> float:
    """Deformation [m] at which a unit's first line meets its strength, bent on its way or not."""
    return min(limit, -1.0 / rising) if rising < 0.0 else limit


def _main(stiffness: Sequence[float], places: Sequence[float], k: float) -> float | None:
    """Where the stiffest of several terms acts; None where it is a small part of the element."""
    terms = zip(map(abs, stiffness), places, strict=True)
    size, place = max(terms, key=itemgetter(0), default=(0.0, 0.0))
    return place if size > SMALL * abs(k) > 0.0 else None


def modal(name: str, square: float, rate: float, about: str) -> Iterator[Parameter]:
    """Frequency and damping ratio of a mode: ω² [1/s²] and 2ζω [1/s]."""
    omega = square**0.5
    yield Parameter(f"{name}.frequency", omega / (2.0 * torch.pi), "Hz", about)
    yield Parameter(f"{name}.damping_ratio", 0.5 * rate / omega, "", about)


# What is known of a simulated structure, under the names of an identified model's parameters.

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
