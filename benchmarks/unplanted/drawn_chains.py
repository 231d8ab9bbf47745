"""Chains of OpenSees' materials whose numbers nobody chose: drawn at random, in any units.

A seed draws units, 2 to 6 storeys, masses, strengths that suit a load that grows with height, a
first period of 0.06 to 0.2 s a storey, 1 to 5 % of damping, and a material of one kind for every
storey (drawn.py). The ground is as strong as takes a storey to a ductility of 2 to 6 in training.
`Isolated`: one mass more, on a friction pendulum (isolated.py); the ground is as strong as makes it
slide as far as was drawn.
A chain of which OpenSees itself is not sure, on the motions that models are judged by, tells
nothing of models: another one is drawn in its place, and the words say so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from zlib import crc32

import numpy as np

from benchmarks.unplanted.drawn import MATERIALS, steel02
from benchmarks.unplanted.frame import GRAVITY
from benchmarks.unplanted.isolated import Isolated, drawn_bearing
from benchmarks.unplanted.shaken import (
    Chain,
    ground_motion,
    itself,
    natural_rates,
    record,
    simulated,
)
from benchmarks.unplanted.structures import FARTHER, TRAINED, UNSEEN
from benchmarks.unplanted.unnamed import UNNAMED

UNITS = {"N, m": (1.0, 1.0), "kN, mm": (1e3, 1e-3), "kip, in": (4448.22, 0.0254)}  # N, m
OF_A_STOREY, SHORTEST, LONGEST = 0.1, 0.6, 2.0  # period [s], drawn between so many times as much
ISOLATED = "Isolated"
COARSE, HALVINGS = 2, 10  # steps of a sample, and steps, of the search for the ground motion
UNSURE, MOST_DRAWN = 5.0, 10  # [%] that OpenSees may be from itself; chains drawn of a seed


def drawn_chain(name: str, seed: int) -> tuple[str, Chain]:
    """What was drawn, in words, and the chain in its own units; motions: those of this seed.

    Raises ValueError where OpenSees is sure of none of ten.
    """
    for again in range(MOST_DRAWN):
        what, chain = (_isolated if name == ISOLATED else _drawn)(name, seed, again)
        if max(from_itself(chain)) <= UNSURE:
            return what + (f", after {again} in doubt" if again else ""), chain
    raise ValueError(f"{name} {seed}: OpenSees is sure of none of {MOST_DRAWN} chains drawn")


def from_itself(chain: Chain) -> list[float]:
    """How far OpenSees is from itself on unseen motions and on larger ones [%]."""
    try:
        every = [
            [record(chain, 400 + i, times * size) for i, size in enumerate(UNSEEN)]
            for times in (1.0, FARTHER)
        ]
        return [itself(chain, records) for records in every]
    except ValueError:  # too far for OpenSees
        return [math.inf]


def _random_numbers(name: str, seed: int, again: int) -> np.random.Generator:
    return np.random.default_rng([seed, crc32(name.encode()), *([again] if again else [])])


def _drawn(name: str, seed: int, again: int) -> tuple[str, Chain]:
    rng = _random_numbers(name, seed, again)
    draw, units = rng.uniform, str(rng.choice(list(UNITS)))
    newton, metre = UNITS[units]
    count = int(rng.integers(2, 7))
    masses = np.exp(draw(-0.15, 0.15, count))
    load = masses * np.arange(1, count + 1)
    shear = np.cumsum(load[::-1])[::-1] / load.sum() * np.exp(draw(-0.15, 0.15, count))
    forces = 10.0 ** draw(5.0, 6.5) / newton * shear
    yielded = draw(0.004, 0.012) / metre * np.exp(draw(-0.2, 0.2, count))
    times = SHORTEST * (LONGEST / SHORTEST) ** draw(0.0, 1.0)
    period, damping = times * OF_A_STOREY * count, draw(0.01, 0.05)
    ductility, drawn = draw(2.0, 6.0), (MATERIALS | UNNAMED)[name]
    storeys = [
        [[kind, *words] for kind, _, *words in drawn(rng, y, f)[0]]
        for y, f in zip(yielded.tolist(), forces.tolist(), strict=True)
    ]
    chain = Chain(masses.tolist(), storeys, 1.0, damping, motions=1000 * seed)
    masses = masses * (natural_rates(chain)[0] * period / (2.0 * math.pi)) ** 2
    chain = replace(chain, masses=masses.tolist())
    chain = replace(chain, peak=_peak(chain, yielded, ductility, forces[0] / masses.sum()))
    what = f"{name} {seed}, {count} storeys, {units}, {period:.2f} s, ductility {ductility:.1f}"
    return what, chain


def _isolated(name: str, seed: int, again: int) -> tuple[str, Chain]:
    """Steel02 or linear springs above the bearing, so stiff that few of them yield."""
    rng = _random_numbers(name, seed, again)
    draw, units = rng.uniform, str(rng.choice(list(UNITS)))
    newton, metre = UNITS[units]
    count, slides = int(rng.integers(1, 5)), draw(0.08, 0.35) / metre
    bearing, gravity = drawn_bearing(rng, slides), GRAVITY / metre
    masses = 10.0 ** draw(4.0, 6.0) / newton * metre * np.exp(draw(-0.3, 0.3, count + 1))
    above = np.cumsum(masses[:0:-1])[::-1]  # what every storey carries
    drift = draw(0.002, 0.006) / metre * np.exp(draw(-0.2, 0.2, count))
    forces = gravity * above * draw(0.25, 0.6)
    linear = rng.random() < 0.5
    storeys: list[list[list[object]]] = [
        [["Elastic", 1, force / y] if linear else steel02(rng, y, force)[0][0]]
        for y, force in zip(drift.tolist(), forces.tolist(), strict=True)
    ]
    chain = Isolated(
        masses.tolist(),
        [[[kind, *words] for kind, _, *words in one] for one in storeys],
        1.0,
        draw(0.01, 0.05),
        motions=1000 * seed,
        bearing=bearing,
        gravity=gravity,
    )
    yielded = np.array([slides, *[math.inf] * count])
    peak = _peak(chain, yielded, 1.0, bearing.fast * gravity)
    what = f"{name} {seed}, {count + 1} masses, {units}, {slides * metre:.2f} m"
    return what, replace(chain, peak=peak)


def _peak(chain: Chain, yielded: np.ndarray, ductility: float, resisted: float) -> float:
    """The largest ground acceleration of training, between shares and times what is resisted."""
    low, high = 0.1 * resisted, 30.0 * resisted
    for _ in range(HALVINGS):
        middle = math.sqrt(low * high)
        far = ductilities(replace(chain, peak=middle), yielded, TRAINED, COARSE)
        low, high = (middle, high) if max(far) < ductility else (low, middle)
    return low


def ductilities(
    chain: Chain, yielded: np.ndarray, sizes: Sequence[float], substeps: int, first: int = 300
) -> list[float]:
    """Largest deformation over where its storey yields, of every ground motion."""
    found = []
    for i, size in enumerate(sizes):
        ground = ground_motion(chain.motions + first + i, size * chain.peak)
        try:
            x = simulated(chain, ground, substeps)[0]
        except ValueError:  # too far for OpenSees
            return [math.inf]
        y = np.diff(x, axis=1, prepend=0.0)
        found.append(float((np.abs(y).max(axis=0) / yielded).max()))
    return found
