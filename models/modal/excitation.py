"""What drives a modal network: the excitation between samples, and its periods.

Between samples, at the ends and middles of substeps: zero_order and linear as they say;
band_limited by the Fourier series of a periodic record, else by the best linear interpolation of a
signal that is flat up to the band's end and has nothing beyond (Oetken, Parks & Schüßler 1975),
from several samples on both sides.
Of a record that repeats itself the mean of the periods is taken: what is left is its noise.
T samples, N of a period, m inputs, o outputs, S substeps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from models.layers.integrate import between

TAPS = 24  # samples on either side
BAND_POWER = 1e-8  # share of the power above the band's end
MARGIN, WIDEST = 1.1, 0.98  # of the band's end; share of half the sampling rate
RIDGE = 1e-11
ALIKE = 0.99  # correlation of the excitation with itself a period later
FEWEST = 64  # samples of a period
SAME = 0.05  # of the RMS of the outputs: largest difference of two periods in the steady state
NOISE = 0.9  # ratio of two successive differences, above which they are noise
SETTLED = 0.03  # of the RMS of the outputs: largest transient that may be left


@dataclass(frozen=True)
class Excited:
    """An excitation in units of the model: at samples u (T, m), and between them."""

    u: np.ndarray
    fine: np.ndarray  # (T − 1, 2S + 1, m)
    dt: float  # in units of the model

    @property
    def step(self) -> float:
        return 2.0 * self.dt / (self.fine.shape[1] - 1)

    def first(self, samples: int) -> Excited:
        return Excited(self.u[:samples], self.fine[:samples], self.dt)


def interpolated(u: np.ndarray, hold: str, substeps: int, periodic: bool = False) -> np.ndarray:
    """u (T, m) → (T − 1, 2S + 1, m), from every sample to just before the next."""
    first, last, halves = u[:-1, None], u[1:, None], 2 * substeps
    if hold == "zero_order":
        return np.ascontiguousarray(np.repeat(first, halves + 1, axis=1))
    if hold == "band_limited" and u.shape[1] > 0 and len(u) > 4:
        if periodic:
            inner = between(torch.from_numpy(u), hold, halves).numpy()[:, :-1]
        else:
            inner = _by_windows(u, halves)
        return np.ascontiguousarray(np.concatenate([first, inner, last], axis=1))
    part = (np.arange(halves + 1) / halves)[:, None]
    return np.ascontiguousarray(first + part * (last - first))


def band_end(u: np.ndarray) -> float:
    """The end of the band that holds all but BAND_POWER of u (T, m), in half sampling rates."""
    faded = (u - u.mean(axis=0)) * np.hanning(len(u))[:, None]
    power = (np.abs(np.fft.rfft(faded, axis=0)) ** 2).sum(axis=1)
    if not power.sum() > 0.0:
        return WIDEST
    inside = np.cumsum(power) < (1.0 - BAND_POWER) * power.sum()
    return float(np.clip(MARGIN * (inside.sum() + 1) / len(power), 0.05, WIDEST))


def _by_windows(u: np.ndarray, parts: int) -> np.ndarray:
    """u (T, m) at the inner points (T − 1, parts − 1, m) of every interval."""
    T, band = len(u), band_end(u)
    mean = u.mean(axis=0)
    past = min(TAPS, T - 2)
    inner = np.arange(1, parts) / parts
    found = np.empty((T - 1, parts - 1, u.shape[1]))
    stop = max(T - 1 - past, past)  # of the intervals that have `past` samples on both sides
    if stop > past:
        whole = np.lib.stride_tricks.sliding_window_view(u - mean, 2 * past + 2, axis=0)
        weights = _weights(past, past, inner, band)
        found[past:stop] = np.einsum("tmw,pw->tpm", whole[: stop - past], weights)
    for k in [*range(past), *range(stop, T - 1)]:  # near the ends of the record
        before, after = min(past, k), min(past, T - 2 - k)
        some = u[k - before : k + 2 + after] - mean
        found[k] = _weights(before, after, inner, band) @ some
    return found + mean


def _weights(before: int, after: int, inner: np.ndarray, band: float) -> np.ndarray:
    """(points, before + after + 2): least mean square error for a flat band up to `band`."""
    at = np.arange(-before, after + 2)
    R = np.sinc(band * (at[:, None] - at)) + RIDGE * np.eye(len(at))
    wanted = np.sinc(band * (inner[:, None] - at))
    return np.linalg.solve(R, wanted.T).T


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
