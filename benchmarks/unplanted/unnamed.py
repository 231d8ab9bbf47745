"""Materials of OpenSees that no named law is, drawn at random: what only a learned law can follow.

Of random numbers, where a material yields, and the force there; as in drawn.py.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Words = list[object]  # of OpenSees' command
Drawn = tuple[list[Words], float]  # in parallel; largest deformation of the training motions


def concrete_and_steel(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """Reinforced concrete, pulled and pushed: it crushes, cracks, and its bars yield."""
    draw = rng.uniform
    concrete: Words = ["Concrete02", 1, -force, -2.0 * yielded, -0.3 * force, -12.0 * yielded]
    concrete += [0.2, 0.1 * force, 0.1 * force / yielded]
    bars = force * draw(0.3, 0.8)
    steel: Words = ["Steel02", 1, bars, 0.5 * force / yielded, 0.02, 18.0, 0.925, 0.15]
    return [concrete, steel], float(yielded * draw(3.0, 6.0))


def sheathing(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """A nailed wall of wood (SAWS), which pinches and softens."""
    draw = rng.uniform
    words: Words = ["SAWS", 1, force, force * draw(0.08, 0.2), yielded * draw(6.0, 12.0)]
    words += [1.5 * force / yielded, draw(0.03, 0.08), -draw(0.03, 0.08), draw(1.0, 1.4)]
    words += [draw(0.02, 0.06), draw(0.6, 0.85), draw(1.05, 1.2)]
    return [words], float(yielded * draw(3.0, 8.0))


def steel4(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """Steel that hardens by kinematic and by isotropic rules of its own."""
    draw = rng.uniform
    words: Words = ["Steel4", 1, force, force / yielded]
    words += ["-kin", draw(0.01, 0.05), draw(15.0, 25.0), 0.9, 0.15]
    words += ["-iso", draw(0.005, 0.02), draw(1.1, 1.4), 0.1 * draw(0.01, 0.04), 50.0, 1.0]
    return [words], float(yielded * draw(3.0, 8.0))


def peak_oriented(rng: np.random.Generator, yielded: float, force: float) -> Drawn:
    """A hinge of a concrete frame after Ibarra, Medina & Krawinkler, which loses strength."""
    draw = rng.uniform
    hardening, lost = draw(0.01, 0.08), draw(60.0, 360.0) * yielded
    plastic, beyond = yielded * draw(4.0, 8.0), yielded * draw(8.0, 20.0)
    words: Words = ["ModIMKPeakOriented", 1, force / yielded, hardening, hardening]
    words += [force, -force * draw(0.8, 1.2), *4 * [lost], *4 * [1.0]]
    words += [*2 * [plastic], *2 * [beyond], 0.3, 0.3, *2 * [plastic + 1.5 * beyond], 1.0, 1.0]
    return [words], float(yielded * draw(3.0, 7.0))


UNNAMED: dict[str, Callable[[np.random.Generator, float, float], Drawn]] = {
    "ConcreteAndSteel": concrete_and_steel,
    "SAWS": sheathing,
    "Steel4": steel4,
    "ModIMKPeakOriented": peak_oriented,
}
