"""Spectra and dominant frequencies of a record."""

from __future__ import annotations

import numpy as np

SEEN = 2_000_000  # most samples of a spectrum, from the middle of the record
Spectrum = tuple[np.ndarray, np.ndarray]  # frequencies [Hz] and power density [unit²/Hz]


def spectrum(signal: np.ndarray, dt: float) -> Spectrum | None:
    """Welch's estimate of at most `SEEN` samples; None where fewer than 16, or half, are finite."""
    from scipy.signal import welch  # slow to import

    first = max(0, (len(signal) - SEEN) // 2)
    piece = signal[first : first + SEEN]
    known = np.isfinite(piece)
    if known.sum() < max(16, 0.5 * len(piece)):
        return None
    if not known.all():
        place = np.arange(len(piece))
        piece = np.interp(place, place[known], piece[known])
    length = int(np.clip(2 ** int(np.log2(max(2, len(piece) // 3))), 256, 32768))
    return welch(piece, 1.0 / dt, nperseg=min(length, len(piece)), detrend="constant")


def dominant(spectrum: Spectrum | None, count: int = 3) -> list[float]:
    """Frequencies [Hz] of the highest peaks that are 10 dB above their surroundings' median."""
    from scipy.ndimage import median_filter  # slow to import
    from scipy.signal import find_peaks  # slow to import

    if spectrum is None or not spectrum[1].max() > 0.0:
        return []
    frequency, power = spectrum
    level = 10.0 * np.log10(np.maximum(power, 1e-16 * power.max()))
    around = median_filter(level, max(31, len(level) // 40))
    peaks = find_peaks(np.concatenate(([level.min()], level)), prominence=6.0)[0] - 1
    peaks = peaks[(peaks > 1) & (level > around + 10.0)[peaks]]
    peaks = peaks[level[peaks] > level.max() - 40.0]
    return [float(frequency[k]) for k in peaks[power[peaks].argsort()[::-1][:count]]]
