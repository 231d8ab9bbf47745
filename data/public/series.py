"""Official records of a public benchmark: which of them train and test, and how they are measured.

n outputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from data.record import SHORTEST, Record

Records = dict[str, Record]  # official time histories by name; `a` is the output, `f` the input


def require_held_out(splits: Mapping[str, Records]) -> None:
    """Raise ValueError where records of two splits hold the same samples of a file."""
    names = list(splits)
    for i, split in enumerate(names):
        for other in names[:i]:
            for (one, a), (two, b) in product(splits[split].items(), splits[other].items()):
                if np.shares_memory(a.counted(a.a).numpy(), b.counted(b.a).numpy()):
                    raise ValueError(
                        f"{split} series {one} has samples of {other} series {two}; change "
                        f"data.{other} or data.{split}"
                    )


def stretch(records: Records, samples: int, seed: int) -> Records:
    """A stretch of one of the records, at a place that the seed draws; how it begins is unknown.

    Raises ValueError where no record is as long.
    """
    long = [name for name, record in records.items() if record.samples >= samples]
    if samples < SHORTEST or not long:
        longest = max(record.samples for record in records.values())
        raise ValueError(f"data.samples={samples}: expected from {SHORTEST} to {longest}")
    draw = np.random.default_rng(seed)
    name = long[draw.integers(len(long))]
    start = int(draw.integers(records[name].samples - samples + 1))
    part = records[name].window(start, samples, samples // 5)
    return {f"{name}, {samples} from {start}": replace(part, initial_state="unknown")}


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
