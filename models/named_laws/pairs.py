"""Two named laws in parallel, as a frame that yields beside its braces.

r = law₁(y, ẏ; q₁) + law₂(y, ẏ; q₂), with one damper. Numbers of both are drawn, their sizes are
those that suit a motion best, and the likeliest pairs are followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from data.simulation.elements import Element
from models.named_laws.candidate import Candidate, Units, Values
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit, Motion, followed
from models.training.doing import doing

SINGLE = (
    "MenegottoPinto",
    "SelfCentering",
    "Takeda",
    "SlackBrace",
    "FrictionPendulum",
    "BaberNoori",
)
TOGETHER = ("damping", "spring")  # of the first law alone; the other's stiffness is a spring
DRAWS, TRIED, ALIVE, LEFT = 60, 2, 6, 2  # of a pair; of them followed; of all; to the end
FEW, MORE = 3, 10  # iterations
LEAST = 1e-2  # of a law's strength as it was drawn: what is left of it at least


def _parallel(first: Candidate, second: Candidate) -> Candidate:
    """The two laws as one, whose parameters are named for their laws."""
    laws = [_without(first, TOGETHER[1:]), _without(second, TOGETHER)]

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return [element for law in laws for element in law.made(_own(law, values), between)]

    parameters = {f"{law.name}.{name}": p for law in laws for name, p in law.parameters.items()}
    sized = [f"{law.name}.{name}" for law in laws for name in law.sized]
    name = f"{first.name} + {second.name}"
    return Candidate(name, parameters, made, sized, halves=tuple(laws))


def _without(law: Candidate, names: Sequence[str]) -> Candidate:
    """The law without some parameters, which are then zero."""
    kept = {name: p for name, p in law.parameters.items() if name not in names}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        missing = [name for name in names if name == "damping" and name in law.parameters]
        return law.made({**values, **dict.fromkeys(missing, 0.0)}, between)

    return replace(law, parameters=kept, made=made)


def _own(law: Candidate, values: Values) -> dict[str, float]:
    return {name: values[f"{law.name}.{name}"] for name in law.parameters}


PAIRS = {
    pair.name: pair
    for names in combinations(SINGLE, 2)
    for pair in [_parallel(*(CANDIDATES[name] for name in names))]
}


def halves(fit: Fit) -> list[Fit]:
    """The laws of a pair, each by itself."""
    laws = fit.candidate.halves
    cuts = np.cumsum([len(law.parameters) for law in laws])[:-1]
    return [Fit(law, fit.units, q) for law, q in zip(laws, np.split(fit.q, cuts), strict=True)]


def nearest(names: Sequence[str], motions: Sequence[Motion], units: Units, seed: int) -> Fit | None:
    """The pair of laws with these names that suits motions best; None where there is none."""
    motions = [motion.thinned() for motion in motions]
    largest = sorted(motions, key=lambda m: -float(np.ptp(m.y)))[:2]
    ends: list[Fit] = []
    for pair in PAIRS.values():
        if not all(law.name in names for law in pair.halves):
            continue
        doing(f"{pair.name} in parallel")
        drawn = sorted(_drawn(pair, largest, units, pair.draws(seed)), key=_error)[:TRIED]
        ends += [followed(one, largest, FEW) for one in drawn]
    alive = [followed(one, largest, FEW) for one in sorted(ends, key=_error)[:ALIVE]]
    last = [followed(one, motions, MORE) for one in sorted(alive, key=_error)[:LEFT]]
    return min(last, key=_error, default=None)


def _drawn(
    pair: Candidate, motions: Sequence[Motion], units: Units, rng: np.random.Generator
) -> Iterator[Fit]:
    for _ in range(DRAWS):
        one = _sized(Fit(pair, units, pair.drawn(rng)), motions[0])
        yield replace(one, error=one.error_on(motions[:1]))


def _sized(fit: Fit, motion: Motion) -> Fit:
    """The pair with laws as strong as suits a motion best."""
    from scipy.optimize import nnls  # slow to import

    laws, first = halves(fit), motion.first
    columns = [law.forces([motion])[0][first:] for law in laws]
    columns += [share[first:] for share in motion.shares.T]
    matrix = np.stack(columns, axis=1)
    lengths = np.linalg.norm(matrix, axis=0)
    if not (np.isfinite(lengths).all() and (lengths > 0.0).all()):
        return fit
    sizes = nnls(matrix / lengths, motion.r[first:])[0] / lengths
    q = [
        law.candidate.sized_anew(law.q, fit.units, {"": max(size, LEAST)})
        for law, size in zip(laws, sizes[: len(laws)].tolist(), strict=True)
    ]
    return replace(fit, q=np.concatenate(q))


def _error(fit: Fit) -> float:
    return fit.error
