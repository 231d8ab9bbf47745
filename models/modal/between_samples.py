"""What the excitation does between samples, at the ends and middles of substeps.

zero_order and linear as they say; band_limited by the Fourier series of a periodic record, else by
the best linear interpolation of a signal that is flat up to the band's end and has nothing beyond
(Oetken, Parks & Schüßler 1975), from so many samples on both sides, or `ahead` samples at most:
with 0 it is causal, and the less exact the nearer the band comes to half the sampling rate.
T samples, m channels, S substeps.
"""

from __future__ import annotations

import numpy as np
import torch

from models.layers.integrate import between

TAPS = 24  # samples on either side
BAND_POWER = 1e-8  # share of the power above the band's end
MARGIN, WIDEST = 1.1, 0.98  # of the band's end; share of half the sampling rate
RIDGE = 1e-11


def interpolated(
    u: np.ndarray, hold: str, substeps: int, ahead: int | None = None, periodic: bool = False
) -> np.ndarray:
    """u (T, m) → (T − 1, 2S + 1, m), from every sample to just before the next."""
    first, last, halves = u[:-1, None], u[1:, None], 2 * substeps
    if hold == "zero_order":
        return np.ascontiguousarray(np.repeat(first, halves + 1, axis=1))
    if hold == "band_limited" and u.shape[1] > 0 and len(u) > 4:
        if periodic and ahead is None:
            inner = between(torch.from_numpy(u), hold, halves).numpy()[:, :-1]
        else:
            inner = _by_windows(u, halves, TAPS if ahead is None else ahead)
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


def _by_windows(u: np.ndarray, parts: int, ahead: int) -> np.ndarray:
    """u (T, m) at the inner points (T − 1, parts − 1, m) of every interval."""
    T, band = len(u), band_end(u)
    mean = u.mean(axis=0)
    past, ahead = min(TAPS, T - 2), min(ahead, TAPS, T - 2)
    inner = np.arange(1, parts) / parts
    found = np.empty((T - 1, parts - 1, u.shape[1]))
    # of interval k, from sample k − before to k + 1 + after; near the ends of the record fewer
    for k in range(T - 1):
        before, after = min(past, k), min(ahead, T - 2 - k)
        if before == past and after == ahead:
            stop = T - 1 - ahead
            whole = np.lib.stride_tricks.sliding_window_view(u - mean, past + ahead + 2, axis=0)
            weights = _weights(past, ahead, inner, band)
            found[k:stop] = np.einsum("tmw,pw->tpm", whole[: stop - k], weights)
            break
        some = u[k - before : k + 2 + after] - mean
        found[k] = _weights(before, after, inner, band) @ some
    for k in range(max(T - 1 - ahead, past), T - 1):
        after = T - 2 - k
        some = u[k - past : k + 2 + after] - mean
        found[k] = _weights(past, after, inner, band) @ some
    return found + mean


def _weights(before: int, after: int, inner: np.ndarray, band: float) -> np.ndarray:
    """(points, before + after + 2): least mean square error for a flat band up to `band`."""
    at = np.arange(-before, after + 2)
    R = np.sinc(band * (at[:, None] - at)) + RIDGE * np.eye(len(at))
    wanted = np.sinc(band * (inner[:, None] - at))
    weights: np.ndarray = np.linalg.solve(R, wanted.T).T
    return weights
