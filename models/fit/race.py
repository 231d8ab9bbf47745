"""Which of many starts ends best, by successive halving (Karnin et al. 2013, Jamieson & Talwalkar
2016).

Starts of all kinds run side by side: each round they take a few more iterations on a longer part of
the motions, and are ranked together; a share of them goes on. A kind that falls behind keeps a few
starts while it is among the better half, for some laws come from behind. What a race costs is known
beforehand: as many iterations for each start as its rounds have.
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
    """One that runs: which kind it is of, and how far it still is from the motions."""

    @property
    def kind(self) -> str: ...

    @property
    def error(self) -> float: ...


EDGE = 1e-6  # of a point between 0 and 1, whose logarithm may be taken
S = TypeVar("S", bound=Start)


class Follow(Protocol[S]):
    """Goes on with a start: on a share of each motion's energy, so many iterations."""

    def __call__(self, start: S, /, share: float, iterations: int) -> S: ...


@dataclass(frozen=True)
class Settings:
    """How a race is run; `python -m benchmarks.elements --settings` shows half and double."""

    draws: int = 16  # starts of a kind, for each number that is drawn of it
    shares: tuple[float, ...] = (0.25, 0.25, 0.5, 1.0)  # of each motion's energy, by round
    iterations: tuple[int, ...] = (0, 2, 4, 8)  # by round
    goes_on: float = 1 / 8  # of all starts, after each round
    kept: int = 3  # starts of a kind that go on in any case, while the kind does
    kinds: float = 1 / 2  # of all kinds, which go on with those
    last: int = 100  # iterations of those that are left, on all of the motions


def spread(draws: int, numbers: int, seed: int) -> np.ndarray:
    """Points (draws, numbers) between 0 and 1, evenly spread: a scrambled sequence of Sobol."""
    engine = SobolEngine(numbers, scramble=True, seed=seed)
    points: np.ndarray = engine.draw(draws, dtype=torch.float64).numpy()
    return points.clip(EDGE, 1.0 - EDGE)


def race(starts: Sequence[S], follow: Follow[S], settings: Settings) -> dict[str, list[S]]:
    """Where the starts of each kind ended or were left, the best first; the nearest kind first."""
    running, left = list(starts), dict[str, list[S]]()
    rounds = list(zip(settings.shares, settings.iterations, strict=True))
    for number, (share, iterations) in enumerate(rounds):
        onward = partial(follow, share=share, iterations=iterations)
        by_kind = _by_kind(in_threads(onward, running))
        left = by_kind | {kind: ends for kind, ends in left.items() if kind not in by_kind}
        announce(f"{len(running)} starts on {share:.0%} of the motions; {', '.join(by_kind)}")
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
    """A share of all, and the best few of the better kinds."""
    ends = [one for some in by_kind.values() for one in some]
    limit = sorted(one.error for one in ends)[math.ceil(settings.goes_on * len(ends)) - 1]
    kinds = list(by_kind)[: max(1, math.ceil(settings.kinds * len(by_kind)))]
    return [
        one
        for kind, some in by_kind.items()
        for place, one in enumerate(some)
        if one.error <= limit or (kind in kinds and place < settings.kept)
    ]
