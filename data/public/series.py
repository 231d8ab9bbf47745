"""Official time histories of a public benchmark, and which of them train and test.

T samples, n outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import product

import numpy as np

FEWEST = 20  # samples of a stretch


@dataclass(frozen=True)
class Series:
    """One official time history."""

    name: str
    dt: float  # [s]
    u: np.ndarray  # input (T, 1)
    y: np.ndarray  # output (T, n)
    warmup: int = 0  # samples that are not counted
    initial_state: str = "rest"

    def cut(self, name: str, start: int, stop: int | None = None) -> Series:
        """Samples `start` … `stop − 1` as a series of their own."""
        return replace(self, name=name, u=self.u[start:stop], y=self.y[start:stop])


def matching(series: Sequence[Series], names: Sequence[str]) -> list[Series]:
    """Series that one of the names, patterns as in a shell, matches."""
    return [s for s in series if any(fnmatchcase(s.name, name) for name in names)]


def choose(split: str, series: Sequence[Series], names: str | Sequence[str]) -> list[Series]:
    """Series of a split by name. Raises ValueError for a name that matches no series."""
    names = [names] if isinstance(names, str) else names
    for name in names:
        if not matching(series, [name]):
            raise ValueError(f"data.{split} holds {name!r}; choose {_names(series)}")
    return matching(series, names)


def _names(series: Sequence[Series]) -> str:
    return ", ".join(s.name for s in series)


def require_held_out(series: Mapping[str, Sequence[Series]]) -> None:
    """Raise ValueError where series of two splits hold the same samples of a file."""
    splits = list(series)
    for i, split in enumerate(splits):
        for other in splits[:i]:
            for one, two in product(series[split], series[other]):
                if np.shares_memory(one.y[one.warmup :], two.y[two.warmup :]):
                    raise ValueError(
                        f"{split} series {one.name} has samples of {_WORDS[other]} series "
                        f"{two.name}; change data.{other} or data.{split}"
                    )


_WORDS = {"train": "training", "test": "test"}


def stretch(series: Sequence[Series], samples: int, seed: int) -> Series:
    """A stretch of one of the series, at a place that the seed draws; how it begins is unknown.

    Raises ValueError where no series is as long.
    """
    long = [s for s in series if len(s.u) >= samples]
    if samples < FEWEST or not long:
        longest = max(len(s.u) for s in series)
        raise ValueError(f"data.samples={samples}: expected from {FEWEST} to {longest}")
    draw = np.random.default_rng(seed)
    chosen = long[draw.integers(len(long))]
    start = int(draw.integers(len(chosen.u) - samples + 1))
    part = chosen.cut(f"{chosen.name}, {samples} from {start}", start, start + samples)
    return replace(part, warmup=samples // 5, initial_state="unknown")
