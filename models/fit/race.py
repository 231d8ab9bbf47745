"""Successive halving: which of many starting points leads to the least error.

Karnin et al. (2013); Jamieson & Talwalkar (2016). In every round all starts of all kinds (such as
laws) take a few more iterations on a longer part of the motions. Then they are ranked together, and
a share of them takes part in the next round, with a few of each of the better kinds: some laws
converge late. The number of iterations is known beforehand.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol, TypeVar

import numpy as np
import torch
from torch.quasirandom import SobolEngine

from data.parallel import in_threads
from models.fit.progress import announce, is_out_of_time


class Start(Protocol):
    """A starting point, or what it has become: its kind, and its error on the motions."""

    @property
    def kind(self) -> str: ...

    @property
    def error(self) -> float: ...


EDGE = 1e-6  # of a point between 0 and 1, whose logarithm may be taken
S = TypeVar("S", bound=Start)


class Follow(Protocol[S]):
    """Takes so many iterations from a start, on the first share of each motion's energy."""

    def __call__(self, start: S, /, share: float, iterations: int) -> S: ...


@dataclass(frozen=True)
class Settings:
    """How a race is run; `python -m benchmarks.elements --settings` shows half and double."""

    draws: int = 16  # starts of a kind, for each of its parameters
    shares: tuple[float, ...] = (0.25, 0.25, 0.5, 1.0)  # of each motion's energy, by round
    iterations: tuple[int, ...] = (0, 2, 4, 8)  # by round
    goes_on: float = 1 / 8  # share of all starts that takes part in the next round
    kinds: float = 1 / 2  # share of all kinds that does
    kept: int = 3  # starts of each of these kinds, whatever their rank; kinds that are fitted last
    last: int = 100  # iterations at most of the last fit, on all of the motions


def spread(draws: int, numbers: int, seed: int) -> np.ndarray:
    """Points (draws, numbers) between 0 and 1, evenly spread: a scrambled sequence of Sobol."""
    engine = SobolEngine(numbers, scramble=True, seed=seed)
    points: np.ndarray = engine.draw(draws, dtype=torch.float64).numpy()
    return points.clip(EDGE, 1.0 - EDGE)


def race(starts: Sequence[S], follow: Follow[S], settings: Settings) -> dict[str, list[S]]:
    """What the starts of each kind became, as of their last round, by rank; kinds by rank."""
    running, left = list(starts), dict[str, list[S]]()
    rounds = list(zip(settings.shares, settings.iterations, strict=True))
    for number, (share, iterations) in enumerate(rounds):
        onward = partial(follow, share=share, iterations=iterations)
        by_kind = _by_kind(in_threads(onward, running))
        left = by_kind | {kind: ends for kind, ends in left.items() if kind not in by_kind}
        best = ", ".join(list(by_kind)[: settings.kept])
        announce(f"nearest of {len(by_kind)} laws on {100 * share:.0f} % of the motion: {best}")
        if number + 1 == len(rounds) or is_out_of_time():
            break
        running = _going_on(by_kind, settings)
    return left


def _by_kind(ends: Sequence[S]) -> dict[str, list[S]]:
    found = defaultdict[str, list[S]](list)
    for one in sorted(ends, key=lambda one: one.error):
        found[one.kind].append(one)
    return dict(found)


def _going_on(by_kind: dict[str, list[S]], settings: Settings) -> list[S]:
    """Those of the next round: a share of all, and the best few of the better kinds."""
    ends = [one for some in by_kind.values() for one in some]
    limit = sorted(one.error for one in ends)[math.ceil(settings.goes_on * len(ends)) - 1]
    kinds = list(by_kind)[: max(1, math.ceil(settings.kinds * len(by_kind)))]
    return [
        one
        for kind, some in by_kind.items()
        for place, one in enumerate(some)
        if one.error <= limit or (kind in kinds and place < settings.kept)
    ]
