"""Response spectrum: peaks of oscillators under an excitation; power of a motion, by period.

The spectrum of u is max |ω² x|, which tends to max |u| for short periods 2π/ω, of

ẍ + 2 ζ ω ẋ + ω² x = u

T samples, c channels, K periods.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

DAMPING = 0.05  # ζ, as of the spectra that structures are designed by
STEP = 1.0 + 2.0 * DAMPING  # from one period to the next: the width of a resonance


def periods_of(samples: int, dt: float) -> np.ndarray:
    """Periods (K,) [s] that a motion can hold, from two samples to its length: powers of `STEP`.

    So the periods of motions of other lengths and sampling rates are the same where both have them.
    """
    ends = (math.log(seconds) / math.log(STEP) for seconds in (2.0 * dt, samples * dt))
    first, last = math.ceil(next(ends)), math.floor(next(ends))
    return np.array([STEP**k for k in range(first, last + 1)])


def spectral_peaks(u: np.ndarray, dt: float, periods: np.ndarray) -> np.ndarray:
    """Largest |ω² x| (K, c), in the units of `u` (T, c); exact for u linear between samples."""
    from scipy.signal import lfilter  # slow to import

    peaks = [np.abs(lfilter(*_filter(period, dt), u, axis=0)) for period in periods]
    return np.array([peak.max(axis=0) for peak in peaks]).reshape(len(periods), u.shape[1])


@lru_cache(4096)
def _filter(period: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients b, a of the filter from u to ω² x."""
    from scipy.signal import cont2discrete  # slow to import

    w = 2.0 * np.pi / period
    oscillator = ([-(w**2)], [1.0, 2.0 * DAMPING * w, w**2])
    b, a, _ = cont2discrete(oscillator, dt, method="foh")
    return np.ravel(b), a


def power_by_period(a: np.ndarray, dt: float, periods: np.ndarray) -> np.ndarray:
    """Power (K,) of a motion `a` (T, c) by period, all channels together, times a constant.

    Every harmonic of the record counts to the period that is next to its own.
    """
    if not len(periods):
        return np.zeros(0)
    power = (np.abs(np.fft.rfft(a, axis=0)) ** 2).sum(axis=1)[1:] / len(a)  # without the mean
    own = 1.0 / np.fft.rfftfreq(len(a), dt)[1:]
    place = np.searchsorted(np.sqrt(periods[1:] * periods[:-1]), own)
    return np.bincount(place, power, minlength=len(periods))
