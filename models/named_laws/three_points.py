"""Three lines that pinch and are damaged as a named law. Starts of its envelope: envelopes.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial

from data.simulation.laws.element import Element
from data.simulation.laws.hysteretic import Hysteretic, UnevenHysteretic
from models.named_laws.candidate import (
    DAMPING,
    STIFFNESS,
    YIELD,
    Candidate,
    Parameter,
    Values,
    share,
)
from models.named_laws.envelopes import (
    envelopes,
    moved,
    names_of,
    points_of,
    uneven_envelopes,
    uneven_moved,
)

COUNT = 3  # of points
POINTS = names_of(COUNT)
_OWN = {field.name for field in fields(Hysteretic)} - {"between"}


def _made(values: Values, between: Sequence[str]) -> list[Element]:
    return [Hysteretic(between=between, **_front(values))]


def _uneven(values: Values, between: Sequence[str]) -> list[Element]:
    """The back by what its numbers are times those of the front."""
    strength = values["back_stiffness"] * values["back_yield_displacement"]
    own = {name: values[name] * values[f"back_{name}"] for name in POINTS}
    back = {"strength_1": strength, **points_of(own, COUNT, strength)}
    ends = {f"back_{name}": value for name, value in back.items()}
    return [UnevenHysteretic(between=between, **_front(values), **ends)]


def _front(values: Values) -> dict[str, float]:
    own = {name: value for name, value in values.items() if name in _OWN}
    return own | points_of(values, COUNT)


SHAPE = {
    "reloading_place": share(0.2, 0.9),
    "reloading_force": share(0.1, 0.9),
    "unloading_exponent": share(0.05, 0.5),
}
GROWTH = {
    "growth_by_ductility": Parameter(1e-3, 0.05),
    "growth_by_energy": Parameter(3e-3, 0.1),
}
PARAMETERS = {
    "stiffness": STIFFNESS,
    "yield_displacement": YIELD,
    **{f"farther_{i}": Parameter(0.5, 4.0) for i in (2, 3)},
    "stronger_2": Parameter(1.05, 2.0),
    "stronger_3": Parameter(0.6, 1.4),
    **SHAPE,
    **GROWTH,
    "damping": DAMPING,
}
OF_BACK = {f"back_{name}": Parameter(0.7, 1.4) for name in ("stiffness", *POINTS)}
PARTS = [list(SHAPE), list(GROWTH)]
UNEVEN_THREE_POINTS = Candidate(
    "UnevenHysteretic",
    PARAMETERS | OF_BACK,
    _uneven,
    read=partial(uneven_envelopes, count=COUNT),
    parts=PARTS,
    moved=partial(uneven_moved, count=COUNT),
)
THREE_POINTS = Candidate(
    "Hysteretic",
    PARAMETERS,
    _made,
    read=partial(envelopes, count=COUNT),
    parts=PARTS,
    moved=partial(moved, count=COUNT),
    uneven=UNEVEN_THREE_POINTS,
)
