"""What the public benchmarks measure: RMS errors, in a band too, and the noise.   n outputs."""

from __future__ import annotations

import numpy as np
from torch import Tensor

from data.record import Record


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
    rms: np.ndarray = np.sqrt(power[inside].sum(axis=0)) / T
    return rms


def official_rmse(estimate: Tensor, record: Record) -> np.ndarray:
    """Root-mean-square error (n,) of an estimate (T, n) of one record, in the output's unit.

    The benchmarks' metric: the state-initialisation window is not counted.
    """
    error = (estimate - record.a)[record.warmup :]
    return error.square().mean(dim=0).sqrt().numpy(force=True)
