"""Whether a record repeats itself, and the mean of its periods: what is left is its noise.

T samples, N of a period, m inputs, o outputs.
"""

from __future__ import annotations

import numpy as np

ALIKE = 0.99  # correlation of the excitation with itself a period later
FEWEST = 64  # samples of a period
SAME = 0.05  # of the RMS of the outputs: largest difference of two periods in the steady state
NOISE = 0.9  # ratio of two successive differences, above which they are noise
SETTLED = 0.03  # of the RMS of the outputs: largest transient that may be left


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


def steady_mean(u: np.ndarray, y: np.ndarray, period: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Means (N, m) and (N, o) of the periods after the first; None where they are not settled.

    Of three periods or more, a transient shows in how their differences shrink; of two it shows in
    their difference, and there must be none.
    """
    whole = len(u) // period
    start = len(u) - whole * period
    cut = [s[start:].reshape(whole, period, -1) for s in (u, y)]
    size = np.sqrt(((cut[1] - cut[1].mean(axis=(0, 1))) ** 2).mean())
    steps = np.sqrt((np.diff(cut[1], axis=0) ** 2).mean(axis=(1, 2))) / max(size, 1e-300)
    if whole == 2:
        return (cut[0].mean(axis=0), cut[1].mean(axis=0)) if steps[0] < SAME else None
    shrunk = steps[1] / max(steps[0], 1e-300)
    left = steps[1] * shrunk / max(1.0 - shrunk, 1e-300)
    if shrunk < NOISE and left > SETTLED:
        return None
    return cut[0][1:].mean(axis=0), cut[1][1:].mean(axis=0)
