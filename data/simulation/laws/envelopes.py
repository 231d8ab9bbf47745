"""Laws with an envelope of some points: their candidates, and starts that are read off the motions.

Points of an envelope that lie between others hide where the others belong: a search by slopes does
not pass them on. Hence every start has points that suit what the force was where a motion went
farther than before.

A law names its points by `yield_displacement` and `stiffness` of the first and, of each further
one i, by how much `farther_i` and `stronger_i` it is than the one before.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from functools import partial

import numpy as np

from data.simulation.laws.candidate import Candidate, Loops, Parameter, Values
from data.simulation.laws.element import Element
from data.simulation.laws.straight_lines import StraightLines

BINS, UPPER = 60, 0.8  # of the deformation; quantile of the force there, of the least damaged
NEAREST, FARTHEST = 0.03, 1.5  # points, of the largest deformation
APART = 1.15  # a point over the one before
DRAWS, ENVELOPES = 3000, 12  # envelopes that are tried, and that are starts
ALIKE = 0.35  # of logarithms of points: envelopes whose points are nearer are one start
LEVEL = 1e-3  # weight of level ends, which the data may not tell


def candidates_of(
    law: type[StraightLines],
    uneven: type[StraightLines],
    parameters: Mapping[str, Parameter],
    numbers: tuple[int, int],
    side: Callable[[Values, float], dict[str, float]],
    shares: Sequence[str] = (),
) -> tuple[Candidate, Candidate]:
    """The law with sides that are alike, and with a back of its own, by what it is times the front.

    numbers: of both, with which models are saved. side: fields of a side by the values of its
    parameters and the strength of its first point. shares: parameters beside the points that a back
    has too, by a factor of the odds.
    """
    count = len(law.PLACES)
    points = names_of(count)
    own = {field.name for field in fields(law)} - {"between"}

    def front(values: Values) -> dict[str, float]:
        return {name: v for name, v in values.items() if name in own} | side(values, 1.0)

    def symmetric(values: Values, between: Sequence[str]) -> list[Element]:
        return [law(between=between, **front(values))]

    def with_back(values: Values, between: Sequence[str]) -> list[Element]:
        back = {name: values[name] * values[f"back_{name}"] for name in points}
        back |= {name: _odds(values[name], values[f"back_{name}"]) for name in shares}
        strength = values["back_stiffness"] * values["back_yield_displacement"]
        ends = {"strength_1": strength, **side(back, strength)}
        of_back = {f"back_{name}": value for name, value in ends.items()}
        return [uneven(between=between, **front(values), **of_back)]

    more = {f"back_{n}": Parameter(0.7, 1.4) for n in ("stiffness", *points, *shares)}
    yields, read = "yield_displacement", partial(envelopes, count=count)
    wider = Candidate(uneven.__name__, {**parameters, **more}, with_back, numbers[1], yields=yields)
    return (
        Candidate(law.__name__, parameters, symmetric, numbers[0], yields, read=read, uneven=wider),
        wider,
    )


def _odds(share: float, times: float) -> float:
    """The share of so many times the odds."""
    return times * share / (1.0 - share + times * share)


def sizes_of(count: int, values: Values, strength: float) -> dict[str, float]:
    """Places [m] and strengths of points, as the fields of an element name them.

    strength: of the first point, over that of the front.
    """
    place = values["yield_displacement"]
    own = {"yield_displacement": place}
    for i in range(2, count + 1):
        place *= 1.0 + values[f"farther_{i}"]
        strength *= values[f"stronger_{i}"]
        own |= {f"displacement_{i}": place, f"strength_{i}": strength}
    return own


def names_of(count: int) -> list[str]:
    """Names of the parameters of points, but for the stiffness."""
    more = [f"{more}_{i}" for more in ("farther", "stronger") for i in range(2, count + 1)]
    return ["yield_displacement", *more]


def farther(loops: Loops) -> tuple[np.ndarray, np.ndarray]:
    """Deformations |y| [m] where motions went farther than before, and the upper forces there [N].

    y and r (T,) of every motion; both sides are taken to be alike.
    """
    places, forces = [], []
    for y, r in loops:
        for side in (1.0, -1.0):
            reached = np.maximum.accumulate(np.maximum(side * y, 0.0))
            new = np.append(False, side * y[1:] > reached[:-1])
            places.append(side * y[new])
            forces.append(side * r[new])
    y, r = np.concatenate(places), np.concatenate(forces)
    bins = np.minimum((BINS * np.sqrt(y / y.max())).astype(int), BINS - 1)
    found = [(np.median(y[bins == i]), np.quantile(r[bins == i], UPPER)) for i in np.unique(bins)]
    return np.array(found)[:, 0], np.array(found)[:, 1]


def envelopes(loops: Loops, rng: np.random.Generator, count: int) -> list[Values]:
    """Points that suit the force where a motion went farther than before, the best first."""
    y, r = farther(loops)
    found = []
    for _ in range(DRAWS):
        drawn = rng.uniform(math.log(NEAREST), math.log(FARTHEST), count)
        places = y.max() * np.sort(np.exp(drawn))
        if (places[1:] < APART * places[:-1]).any():
            continue
        hats = [np.interp(y, np.append(0.0, places), e) for e in np.eye(count + 1)[1:]]
        matrix = np.vstack([np.stack(hats, axis=1), LEVEL * np.eye(count)])
        target = np.append(r, np.full(count, LEVEL * r.max()))
        heights = np.linalg.lstsq(matrix, target, rcond=None)[0]
        if (heights > 0.0).all():
            found.append((float(np.linalg.norm(matrix @ heights - target)), places, heights))
    taken: list[tuple[np.ndarray, np.ndarray]] = []
    for _, places, heights in sorted(found, key=lambda one: one[0]):
        far = [np.abs(np.log(places / other)).max() for other, _ in taken]
        if min(far, default=math.inf) > ALIKE and len(taken) < ENVELOPES:
            taken.append((places, heights))
    return [_values(*one) for one in taken] or [{}]


def _values(places: np.ndarray, heights: np.ndarray) -> dict[str, float]:
    """Places [m] and forces [N] of points as parameters."""
    values = {"yield_displacement": places[0], "stiffness": heights[0] / places[0]}
    for i in range(1, len(places)):
        values |= {f"farther_{i + 1}": places[i] / places[i - 1] - 1.0}
        values |= {f"stronger_{i + 1}": heights[i] / heights[i - 1]}
    return values
