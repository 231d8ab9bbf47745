"""Whether a record repeats itself, and the mean of its periods: what is left is its noise.

T samples, N of a period, m inputs, o outputs.
"""

from __future__ import annotations

import numpy as np

ALIKE = 0.99  # correlation of the excitation with itself a period later
FEWEST = 64  # samples of a period


def period_of(u: np.ndarray) -> int | None:
    """The period in samples of an excitation u (T, m) that repeats itself; None: it does not."""
    T = len(u)
    if T < 2 * FEWEST or u.shape[1] == 0:
        return None
    s = u - u.mean(axis=0)
    spectrum = np.fft.rfft(s, 2 * T, axis=0)
    products = np.fft.irfft((np.abs(spectrum) ** 2).sum(axis=1))[: T // 2 + 1]
    power = np.r_[0.0, np.cumsum((s * s).sum(axis=1))]
    lags = np.arange(T // 2 + 1)
    both = np.sqrt((power[T - lags] - power[0]) * (power[T] - power[lags]))
    likeness = products / np.maximum(both, 1e-300)
    alike = np.flatnonzero(likeness > ALIKE)
    apart = np.flatnonzero(likeness < 0.5)  # of a slow signal, neighbours are alike as well
    if not len(apart):
        return None
    alike = alike[(alike > apart[0]) & (alike >= FEWEST)]
    if not len(alike):
        return None
    near = alike[alike < alike[0] + max(2, alike[0] // 100)]
    return int(near[np.argmax(likeness[near])])


def steady_mean(
    u: np.ndarray, y: np.ndarray, period: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Means (N, m), (N, o) of the periods after the first; RMS (o,) of the noise in one period.

    The noise is None where there is one period alone after the first.
    """
    whole = len(u) // period
    start = len(u) - (whole - 1) * period
    if whole - 1 < 1:
        return u, y, None
    cut = [s[start:].reshape(whole - 1, period, -1) for s in (u, y)]
    noise = None if whole < 3 else np.sqrt(cut[1].var(axis=0, ddof=1).mean(axis=0))
    return cut[0].mean(axis=0), cut[1].mean(axis=0), noise
