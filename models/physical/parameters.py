"""Physical parameters of one element, by the kind of its law: springs, dampers, yield, gaps.

Names have the form part.quantity or part.term.quantity: x1.mass, r2.stiffness,
r2.unit_1.yield_displacement. Parts: DOFs x1, …, elements r1, …, modes mode_1, …, the structure.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from models.composition.coefficients import Coefficients
from models.composition.laws import GROUPS, NAMED, ElementLaws
from models.estimator import Parameter

SMALL = 0.05  # of an element's stiffness: hinges and units that are told term by term alone


def composed_laws(laws: ElementLaws, e: int, part: str, about: str) -> Iterator[Parameter]:
    """Of element e: stiffness and damping of small motions, gaps, hysteretic units by their limits.

    A unit bears its stiffness up to its yield displacement, and then its yield force; `rising` and
    `falling` bend its way there (models/composition/laws.py): with `rising` b < 0 it tends to 1/|b|
    where that is nearer, so that it yields there. Once all have yielded the element
    has its post-yield stiffness, springs beyond gaps aside. Gap, yield displacement and yield force
    of the element are those of its stiffest hinge and unit, where they are no small part of it.
    """
    for attribute, name, unit in NAMED:
        coefficients = getattr(laws, attribute)
        if _acts(coefficients, e):
            yield Parameter(f"{part}.{name}", float(coefficients()[e]), unit, about)
    for group, all_columns in GROUPS:
        columns = [c for c in all_columns if _acts(getattr(laws, c[0]), e)]
        table = [getattr(laws, attribute)()[e].tolist() for attribute, *_ in columns]
        rows = sorted(zip(*table, strict=True))
        for i, row in enumerate(rows, start=1):
            for value, (_, name, unit) in zip(row, columns, strict=True):
                yield Parameter(f"{part}.{group}_{i}.{name}", value, unit, about)
            if group == "unit":
                yields_at = yield_point(row[0], row[2] if len(row) > 2 else 0.0)
                yield Parameter(
                    f"{part}.unit_{i}.yield_force", yields_at * row[1], "N", about, derived=True
                )
    k, (hinges, _, units) = float(laws.stiffness()[e]), laws.counts
    if hinges and (gap := _main(laws.hinge_stiffness()[e], laws.hinge_gap()[e], k)):
        yield Parameter(f"{part}.gap", gap, "m", about, derived=True)
    if units:
        left = k - float(laws.unit_stiffness()[e].sum())
        yield Parameter(f"{part}.post_yield_stiffness", left, "N/m", about, derived=True)
        if k > 0.0:
            yield Parameter(f"{part}.post_yield_ratio", left / k, "", about, derived=True)
        pairs = zip(laws.unit_limit()[e].tolist(), laws.unit_rising()[e].tolist(), strict=True)
        places = torch.tensor([yield_point(*pair) for pair in pairs], dtype=torch.float64)
        if place := _main(laws.unit_stiffness()[e], places, k):
            yield Parameter(f"{part}.yield_displacement", place, "m", about, derived=True)
            yield Parameter(f"{part}.yield_force", k * place, "N", about, derived=True)


def yield_point(limit: float, rising: float) -> float:
    """Deformation [m] at which a unit's first line meets its strength, bent on its way or not."""
    return min(limit, -1.0 / rising) if rising < 0.0 else limit


def _acts(coefficients: Coefficients, e: int) -> bool:
    return bool(coefficients.unit[e].any()) and (
        coefficients.learned or bool(coefficients()[e].any())
    )


def _main(stiffness: Tensor, place: Tensor, k: float) -> float | None:
    """Where the stiffest of several terms acts; None where it is a small part of the element."""
    size = stiffness.abs()
    strongest = int(size.argmax())
    return float(place[strongest]) if float(size[strongest]) > SMALL * abs(k) > 0.0 else None


def modal(name: str, square: float, rate: float, about: str) -> Iterator[Parameter]:
    """Frequency and damping ratio of a mode: ω² [1/s²] and 2ζω [1/s]."""
    omega = square**0.5
    yield Parameter(f"{name}.frequency", omega / (2.0 * torch.pi), "Hz", about)
    yield Parameter(f"{name}.damping_ratio", 0.5 * rate / omega, "", about)
