"""Statistics of a channel, and runs of samples within it.   T samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Statistics:
    """Statistics of the finite samples of a channel, in its unit."""

    minimum: float
    maximum: float
    mean: float
    std: float
    finite: int
    nans: int
    infinite: int


def statistics(signal: np.ndarray) -> Statistics:
    """Range, mean and deviation of a channel (T,), without what is not finite."""
    finite = signal
    nans = infinite = 0
    if not np.isfinite(signal.min(initial=0.0) + signal.max(initial=0.0)):
        nans = int(np.isnan(signal).sum())
        infinite = int(np.isinf(signal).sum())
        finite = signal[np.isfinite(signal)]
    if not len(finite):
        return Statistics(np.nan, np.nan, np.nan, np.nan, 0, nans, infinite)
    mean, std = float(finite.mean()), _deviation(finite)
    low, high = float(finite.min()), float(finite.max())
    return Statistics(low, high, mean, std, len(finite), nans, infinite)


def _deviation(signal: np.ndarray, chunk: int = 65536) -> float:
    """Standard deviation, in pieces that stay in the cache."""
    mean, total = signal.mean(), 0.0
    for start in range(0, len(signal), chunk):
        piece = signal[start : start + chunk] - mean
        total += float(piece @ piece)
    return float(np.sqrt(total / len(signal)))


def runs(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(where.astype(np.int8), prepend=0, append=0))
    return edges[::2], edges[1::2] - edges[::2]
