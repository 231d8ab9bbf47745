"""Two named laws in parallel, as a frame that yields beside its braces.

r = law₁(y, ẏ; q₁) + law₂(y, ẏ; q₂), with one damper. Numbers of both are drawn, their sizes are
those that suit a motion best, and the likeliest pairs are followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from operator import attrgetter

import numpy as np

from data.simulation.laws.candidate import Candidate, Units, Values
from data.simulation.laws.element import Element
from models.fit.progress import announce, leaves_out
from models.named_laws.candidates import CANDIDATES
from models.named_laws.fit import Fit, Motion, followed, two_largest

FIRST = (5, 0, 1, 2, 3, 6)  # numbers of laws that had pairs first, in their order
DRAWS, TRIED, ALIVE, LEFT = 60, 2, 6, 2  # of a pair; of them followed; of all; to the end
FEW, MORE = 3, 10  # iterations
ERROR = attrgetter("error")
LEAST = 1e-2  # of a law's strength as it was drawn: what is left of it at least


def _parallel(first: Candidate, second: Candidate) -> Candidate:
    """The two laws as one, whose parameters are named for their laws."""
    laws = [_without(first, "spring"), _without(second, "spring", "damping")]

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return [element for law in laws for element in law.made(_own(law, values), between)]

    parameters = {f"{law.name}.{name}": p for law in laws for name, p in law.parameters.items()}
    return Candidate(f"{first.name} + {second.name}", parameters, made, halves=tuple(laws))


def _without(law: Candidate, *names: str) -> Candidate:
    """The law without a damper or a spring of its own: the other law has one."""
    kept = {name: p for name, p in law.parameters.items() if name not in names}

    def made(values: Values, between: Sequence[str]) -> list[Element]:
        return law.made({"damping": 0.0, **values}, between)

    return replace(law, parameters=kept, made=made)


def _own(law: Candidate, values: Values) -> dict[str, float]:
    return {name: values[f"{law.name}.{name}"] for name in law.parameters}


def _pairs() -> list[Candidate]:
    """All pairs, those of later laws last: models are saved with their places.

    Of the first six laws, the order is that of combinations.
    """
    order = [law for law in CANDIDATES.values() if law.paired]
    order.sort(key=lambda law: FIRST.index(law.number) if law.number in FIRST else len(FIRST))
    places = sorted(combinations(range(len(order)), 2), key=lambda two: max(two[1], len(FIRST) - 1))
    return [_parallel(order[one], order[two]) for one, two in places]


PAIRS = {pair.name: pair for pair in _pairs()}


def halves(fit: Fit) -> list[Fit]:
    """The laws of a pair, each by itself."""
    laws = fit.candidate.halves
    cuts = np.cumsum([len(law.parameters) for law in laws])[:-1]
    return [Fit(law, fit.units, q) for law, q in zip(laws, np.split(fit.q, cuts), strict=True)]


def nearest(names: Sequence[str], motions: Sequence[Motion], units: Units, seed: int) -> Fit | None:
    """The pair of laws with these names that suits motions best; None where there is none."""
    motions = [motion.thinned() for motion in motions]
    largest = two_largest(motions)
    ends: list[Fit] = []
    for pair in PAIRS.values():
        if not all(law.name in names for law in pair.halves):
            continue
        if leaves_out(f"{pair.name} in parallel"):
            continue
        announce(f"{pair.name} in parallel")
        drawn = sorted(_drawn(pair, largest, units, pair.draws(seed)), key=ERROR)[:TRIED]
        ends += [followed(one, largest, FEW) for one in drawn]
    alive = [followed(one, largest, FEW) for one in sorted(ends, key=ERROR)[:ALIVE]]
    last = [followed(one, motions, MORE) for one in sorted(alive, key=ERROR)[:LEFT]]
    return min(last, key=ERROR, default=None)


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
