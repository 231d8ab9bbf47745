"""Pinching with four points as a named law. Starts of its envelope: envelopes.py."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import partial

from data.simulation.laws.element import Element
from data.simulation.laws.pinching4 import Pinching4, UnevenPinching4
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

LOSSES = ("softening", "lengthening", "weakening")
LOSS = {
    "by_excursion": Parameter(0.01, 0.5),
    "by_energy": Parameter(0.01, 0.5),
    "excursion_power": Parameter(0.2, 1.5),
    "energy_power": Parameter(0.2, 1.5),
    "limit": share(0.3, 0.9),
}
COUNT = 4  # of points


def _made(values: Values, between: Sequence[str]) -> list[Element]:
    own = {name: v for name, v in values.items() if name in _OWN}
    return [Pinching4(between=between, **(own | _side(values)))]


def _uneven(values: Values, between: Sequence[str]) -> list[Element]:
    """The back by what its numbers are times those of the front, its shares by their odds."""
    own = {name: v for name, v in values.items() if name in _OWN}
    back = {name: values[name] * values[f"back_{name}"] for name in POINTS}
    back |= {name: _odds(values[name], values[f"back_{name}"]) for name in SHAPE}
    strength = values["back_stiffness"] * values["back_yield_displacement"]
    ends = {f"back_{name}": v for name, v in _side(back, strength).items()}
    ends["back_strength_1"] = strength
    return [UnevenPinching4(between=between, **(own | _side(values)), **ends)]


def _side(values: Values, strength: float = 1.0) -> dict[str, float]:
    """Points, by how much farther and stronger each is than the one before, and pinching.

    strength: of the first point, over that of the front.
    """
    own = points_of(values, COUNT, strength)
    unloading = 2.0 * values["unloading"] - 1.0
    least = max(unloading, 0.0)
    return own | {
        "reloading_place": values["reloading_place"],
        "unloading_force": unloading,
        "reloading_force": least + (1.0 - least) * values["reloading"],
    }


def _odds(share: float, times: float) -> float:
    """The share of so many times the odds."""
    return times * share / (1.0 - share + times * share)


POINTS = names_of(COUNT)
_OWN = {field.name for field in fields(Pinching4)} - {"between"}
SHAPE = {
    "unloading": share(0.4, 0.6),
    "reloading_place": share(0.1, 0.8),
    "reloading": share(0.1, 0.6),
}
OF_LOSS = {
    loss: {f"{loss}_{part}": parameter for part, parameter in LOSS.items()} for loss in LOSSES
}
PARAMETERS = {
    "stiffness": STIFFNESS,
    "yield_displacement": YIELD,
    **{f"farther_{i}": Parameter(0.5, 4.0) for i in (2, 3, 4)},
    "stronger_2": Parameter(1.05, 2.0),
    "stronger_3": Parameter(0.9, 1.4),
    "stronger_4": Parameter(0.4, 1.2),
    **SHAPE,
    **OF_LOSS["softening"],
    **OF_LOSS["lengthening"],
    **OF_LOSS["weakening"],
    "damping": DAMPING,
}
OF_BACK = {f"back_{n}": Parameter(0.7, 1.4) for n in ("stiffness", *POINTS, *SHAPE)}
PARTS = [list(part) for part in (SHAPE, *OF_LOSS.values())]
UNEVEN_FOUR_POINTS = Candidate(
    "UnevenPinching4",
    PARAMETERS | OF_BACK,
    _uneven,
    read=partial(uneven_envelopes, count=COUNT),
    parts=[*PARTS, [f"back_{name}" for name in SHAPE]],
    moved=partial(uneven_moved, count=COUNT),
)
FOUR_POINTS = Candidate(
    "Pinching4",
    PARAMETERS,
    _made,
    read=partial(envelopes, count=COUNT),
    parts=PARTS,
    moved=partial(moved, count=COUNT),
    uneven=UNEVEN_FOUR_POINTS,
)
