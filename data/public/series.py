"""Official time histories of a public benchmark, and which of them train and test.

T samples, n outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from itertools import product

import numpy as np

from data.record import SHORTEST


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
    if samples < SHORTEST or not long:
        longest = max(len(s.u) for s in series)
        raise ValueError(f"data.samples={samples}: expected from {SHORTEST} to {longest}")
    draw = np.random.default_rng(seed)
    chosen = long[draw.integers(len(long))]
    start = int(draw.integers(len(chosen.u) - samples + 1))
    part = chosen.cut(f"{chosen.name}, {samples} from {start}", start, start + samples)
    return replace(part, warmup=samples // 5, initial_state="unknown")


# What the public benchmarks measure: RMS errors, in a band too, and the noise.   n outputs.


def noise_floor(periods: np.ndarray) -> np.ndarray | None:
    """RMS (n,) of the noise, from repeated periods (P, T, n) of the steady state.

    Unbiased: Σ (y − ȳ)² / (P − 1). None for a single period.
    """
    if len(periods) < 2:
        return None
    square: np.ndarray = periods.var(axis=0, ddof=1).mean(axis=0)
    return np.sqrt(square)


def in_band_rms(error: np.ndarray, dt: float, band: tuple[float, float]) -> np.ndarray:
    """RMS (n,) of the part of `error` (T, n) within `band` [Hz], its ends included.

    By Parseval's theorem, Σ e² = Σ |E|² / T, without a window: exact for whole periods, elsewhere
    the leakage over the edges of the band is lost or gained.
    """
    low, high = band
    if not 0.0 <= low < high:
        raise ValueError(f"band={band} Hz must rise from 0 or more")
    T = len(error)
    frequencies = np.fft.rfftfreq(T, dt)
    power = np.abs(np.fft.rfft(error, axis=0)) ** 2
    mirrored = (frequencies > 0.0) & (2 * np.arange(len(frequencies)) < T)
    power[mirrored] *= 2.0  # the negative frequencies
    slack = 1e-9 / dt
    inside = (frequencies >= low - slack) & (frequencies <= high + slack)
    return np.sqrt(power[inside].sum(axis=0)) / T
