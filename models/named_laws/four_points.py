"""Pinching with four points as a named law, and starts of its envelope, read off the motions.

Points of an envelope that lie between others hide where the others belong: a search by slopes does
not pass them on. Hence every start has points that suit what the force was where a motion went
farther than before, and a search may take a point out and put it elsewhere on the envelope.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields

import numpy as np

from data.simulation.elements import Element, Pinching4, UnevenPinching4
from models.named_laws.candidate import (
    DAMPING,
    STIFFNESS,
    YIELD,
    Candidate,
    Loops,
    Parameter,
    Values,
    share,
)

LOSSES = ("softening", "lengthening", "weakening")
LOSS = {
    "by_excursion": Parameter(0.01, 0.5),
    "by_energy": Parameter(0.01, 0.5),
    "excursion_power": Parameter(0.2, 1.5),
    "energy_power": Parameter(0.2, 1.5),
    "limit": share(0.3, 0.9),
}
BINS, UPPER = 60, 0.8  # of the deformation; quantile of the force there, of the least damaged
NEAREST, FARTHEST = 0.03, 1.5  # points, of the largest deformation
APART = 1.15  # a point over the one before
DRAWS, ENVELOPES = 3000, 12  # envelopes that are tried, and that are starts
ALIKE = 0.35  # of logarithms of points: envelopes whose points are nearer are one start
BOTH = (1.0, -1.0)  # sides
LEVEL = 1e-3  # weight of level ends, which the data may not tell


def _made(values: Values, between: Sequence[str]) -> list[Element]:
    own = {name: v for name, v in values.items() if name in _OWN}
    return [Pinching4(between=between, **(own | _side(values)))]


def _uneven(values: Values, between: Sequence[str]) -> list[Element]:
    """The back by what its numbers are times those of the front, its shares by their odds."""
    own = {name: v for name, v in values.items() if name in _OWN}
    back = {name: values[name] * values[f"back_{name}"] for name in _POINTS}
    back |= {name: _odds(values[name], values[f"back_{name}"]) for name in SHAPE}
    strength = values["back_stiffness"] * values["back_yield_displacement"]
    ends = {f"back_{name}": v for name, v in _side(back, strength).items()}
    ends["back_strength_1"] = strength
    return [UnevenPinching4(between=between, **(own | _side(values)), **ends)]


def _side(values: Values, strength: float = 1.0) -> dict[str, float]:
    """Points, by how much farther and stronger each is than the one before, and pinching.

    strength: of the first point, over that of the front.
    """
    place = values["yield_displacement"]
    own = {"yield_displacement": place, "reloading_place": values["reloading_place"]}
    for i in (2, 3, 4):
        place *= 1.0 + values[f"farther_{i}"]
        strength *= values[f"stronger_{i}"]
        own |= {f"displacement_{i}": place, f"strength_{i}": strength}
    unloading = 2.0 * values["unloading"] - 1.0
    least = max(unloading, 0.0)
    own |= {
        "unloading_force": unloading,
        "reloading_force": least + (1.0 - least) * values["reloading"],
    }
    return own


def _odds(share: float, times: float) -> float:
    """The share of so many times the odds."""
    return times * share / (1.0 - share + times * share)


def farther(loops: Loops, sides: Sequence[float] = BOTH) -> tuple[np.ndarray, np.ndarray]:
    """Deformations |y| [m] where motions went farther than before, and the upper forces there [N].

    y and r (T,) of every motion; sides that are taken to be alike.
    """
    places, forces = [], []
    for y, r in loops:
        for side in sides:
            reached = np.maximum.accumulate(np.maximum(side * y, 0.0))
            new = np.append(False, side * y[1:] > reached[:-1])
            places.append(side * y[new])
            forces.append(side * r[new])
    y, r = np.concatenate(places), np.concatenate(forces)
    bins = np.minimum((BINS * np.sqrt(y / y.max())).astype(int), BINS - 1)
    found = [(np.median(y[bins == i]), np.quantile(r[bins == i], UPPER)) for i in np.unique(bins)]
    return np.array(found)[:, 0], np.array(found)[:, 1]


def envelopes(
    loops: Loops, rng: np.random.Generator, sides: Sequence[float] = BOTH
) -> list[Values]:
    """Points that suit the force where a motion went farther than before, the best first."""
    y, r = farther(loops, sides)
    found = []
    for _ in range(DRAWS):
        places = y.max() * np.sort(np.exp(rng.uniform(math.log(NEAREST), math.log(FARTHEST), 4)))
        if (places[1:] < APART * places[:-1]).any():
            continue
        hats = [np.interp(y, np.append(0.0, places), e) for e in np.eye(5)[1:]]
        matrix = np.vstack([np.stack(hats, axis=1), LEVEL * np.eye(4)])
        target = np.append(r, np.full(4, LEVEL * r.max()))
        heights = np.linalg.lstsq(matrix, target, rcond=None)[0]
        if (heights > 0.0).all():
            found.append((float(np.linalg.norm(matrix @ heights - target)), places, heights))
    taken: list[tuple[np.ndarray, np.ndarray]] = []
    for _, places, heights in sorted(found, key=lambda one: one[0]):
        far = [np.abs(np.log(places / other)).max() for other, _ in taken]
        if min(far, default=math.inf) > ALIKE and len(taken) < ENVELOPES:
            taken.append((places, heights))
    return [_points(*one) for one in taken] or [{}]


def uneven_envelopes(loops: Loops, rng: np.random.Generator) -> list[Values]:
    """Envelopes of either side for itself, the best with the best."""
    front, back = (envelopes(loops, rng, [side]) for side in BOTH)
    return [
        {**one, **{f"back_{name}": v / one[name] for name, v in other.items()}}
        for one, other in zip(front, back, strict=False)
        if one and other
    ]


def _points(places: np.ndarray, heights: np.ndarray) -> dict[str, float]:
    """Places [m] and forces [N] of the four points as parameters."""
    values = {"yield_displacement": places[0], "stiffness": heights[0] / places[0]}
    values |= {f"farther_{i + 1}": places[i] / places[i - 1] - 1.0 for i in (1, 2, 3)}
    return values | {f"stronger_{i + 1}": heights[i] / heights[i - 1] for i in (1, 2, 3)}


def moved(values: Values, rng: np.random.Generator) -> Values:
    """One of the points taken out, and put elsewhere on the lines through the others."""
    steps = [1.0 + values[f"farther_{i}"] for i in (2, 3, 4)]
    places = values["yield_displacement"] * np.cumprod([1.0, *steps])
    heights = np.cumprod([1.0, *(values[f"stronger_{i}"] for i in (2, 3, 4))])
    heights = heights * values["stiffness"] * places[0]
    out = rng.integers(4)
    x, f = np.append(0.0, np.delete(places, out)), np.append(0.0, np.delete(heights, out))
    line = rng.integers(4)  # somewhere on it, or beyond the last point
    beyond = FARTHEST * x[-1] if line == 3 else x[line + 1]
    place = x[line] + rng.uniform(0.1, 0.9) * (beyond - x[line])
    return _points(
        np.insert(x, line + 1, place)[1:], np.insert(f, line + 1, np.interp(place, x, f))[1:]
    )


_POINTS = (
    "yield_displacement",
    *(f"{more}_{i}" for more in ("farther", "stronger") for i in (2, 3, 4)),
)
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
OF_BACK = {f"back_{n}": Parameter(0.7, 1.4) for n in ("stiffness", *_POINTS, *SHAPE)}
PARTS = [list(part) for part in (SHAPE, *OF_LOSS.values())]
UNEVEN_FOUR_POINTS = Candidate(
    "UnevenPinching4",
    PARAMETERS | OF_BACK,
    _uneven,
    read=uneven_envelopes,
    parts=[*PARTS, [f"back_{name}" for name in SHAPE]],
)
FOUR_POINTS = Candidate(
    "Pinching4",
    PARAMETERS,
    _made,
    read=envelopes,
    parts=PARTS,
    moved=moved,
    uneven=UNEVEN_FOUR_POINTS,
)
