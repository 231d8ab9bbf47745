"""Spectra and dominant frequencies of a record, and a picture of every channel."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from data.arguments import label
from data.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SEEN = 2_000_000  # most samples of a spectrum, from the middle of the record
COLUMNS = 2000  # of a time history: more samples are drawn as least and largest by column
ROWS = 16  # channels in one picture
DRAWN = (1e-280, 1e280)  # power densities [unit²/Hz] that a logarithmic axis can bear
LINE, LACK = "#222222", "#d1495b"
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


def draw(
    path: Path,
    title: str,
    channels: Mapping[str, np.ndarray],
    steps: Mapping[str, float],
    spectra: Mapping[str, Spectrum | None],
    units: Mapping[str, str],
    timed: bool = True,
) -> None:
    """PNG of time histories and power spectra, a row per channel; missing samples in red.

    steps: time step of each channel [s], or 1 where unknown (`timed` false).
    """
    from matplotlib.figure import Figure  # slow to import, and only for pictures

    shown = list(channels)[:ROWS]
    if len(channels) > ROWS:
        title += f"; the first {ROWS} of {len(channels)} channels"
    if max(len(channels[name]) for name in shown) > SEEN:
        title += f"; spectra of the middle {SEEN:,} samples"
    figure = Figure(figsize=(11.0, 1.7 * len(shown) + 1.0), layout="constrained")
    figure.suptitle(label(title, 150), fontsize=10)
    grid = figure.subplots(len(shown), 2, squeeze=False, width_ratios=(2, 1), sharex="col")
    for (left, right), name in zip(grid, shown, strict=True):
        unit = units.get(name, "").replace("^2", "²")
        _history(left, channels[name], steps[name])
        words = label(name, 24)
        left.set_ylabel(f"{words} [{label(unit, 12)}]" if unit else words)
        _density(right, spectra[name])
        right.set_ylabel(f"[({label(unit, 12)})²/Hz]" if unit else "power density", fontsize=8)
    grid[-1, 0].set_xlabel("time [s]" if timed else "sample")
    grid[-1, 1].set_xlabel("frequency [Hz]" if timed else "frequency [1/sample]")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")  # drawn as a box
        with whole_file(path) as aside:
            figure.savefig(aside, format=path.suffix[1:] or "png", dpi=110)


def _history(axes: Axes, signal: np.ndarray, dt: float) -> None:
    low, high, width = envelope(signal)
    time = dt * width * np.arange(len(low))
    if width == 1:
        axes.plot(time, low, color=LINE, linewidth=0.8)
    else:
        ends = np.column_stack((low, high)).ravel()
        axes.plot(np.repeat(time, 2), ends, color=LINE, linewidth=0.5)
    lacking = np.flatnonzero(~np.isfinite(low))
    for k in lacking[:50]:
        axes.axvspan(time[k], time[k] + dt * width, color=LACK, alpha=0.4, linewidth=1.5)
    axes.margins(x=0.01)
    axes.grid(alpha=0.25)


def envelope(signal: np.ndarray, columns: int = COLUMNS) -> tuple[np.ndarray, np.ndarray, int]:
    """Least and largest of every `width` samples, NaN where one of them is not finite."""
    width = max(1, len(signal) // columns)
    whole = signal[: len(signal) // width * width].reshape(-1, width)
    with np.errstate(invalid="ignore"):
        low, high = whole.min(axis=1), whole.max(axis=1)
    lacking = ~np.isfinite(low + high)
    return np.where(lacking, np.nan, low), np.where(lacking, np.nan, high), width


def _density(axes: Axes, spectrum: Spectrum | None) -> None:
    if spectrum is None or not DRAWN[0] < spectrum[1].max() < DRAWN[1]:
        axes.text(0.5, 0.5, "no spectrum", ha="center", va="center", transform=axes.transAxes)
        return
    frequency, power = spectrum
    axes.semilogy(frequency[1:], np.maximum(power[1:], 1e-14 * power.max()), color=LINE, lw=0.8)
    peaks = dominant(spectrum)
    for f in peaks:
        axes.axvline(f, color=LACK, linewidth=0.8, alpha=0.6)
    if peaks:
        text = ", ".join(f"{f:.3g}" for f in sorted(peaks)) + " Hz"
        axes.set_title(text, fontsize=8, loc="right", pad=2, color=LACK)
    axes.grid(alpha=0.25)
