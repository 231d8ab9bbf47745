"""Samples with gaps, and sensors with clocks of their own → one even grid.   T samples.

Gaps are filled by PCHIP, which stays between its neighbours where a spline would swing. Rates are
changed by quintic splines. Relative rms errors of a sine at 1/10 and 1/4 of the sampling rate:
quintic 3e-6 and 0.2 %, cubic 3e-4 and 1.9 %, PCHIP, which flattens every peak, 1 % and 12 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from data.measured.raw_record import RawRecord
from data.measured.statistics import runs
from data.measured.time_step import even_times, time_step
from data.memory import require_memory

PASS = 0.8  # of the new Nyquist frequency: −6 dB point of the anti-alias filter
ANTI_ALIAS_ORDER = 8
Channels = dict[str, np.ndarray]


@dataclass(frozen=True)
class Sampled:
    """One channel and its times; rounded stamps are replaced by the even times they stand for."""

    time: np.ndarray  # (T,) [s]
    values: np.ndarray  # (T,)
    dt: float  # [s]
    troubles: frozenset[str]  # faults of its clock, as data.measured.time_step names them


def sampled(raw: RawRecord) -> dict[str, Sampled]:
    """The channels of a record, each with its clock. Raises ValueError for an impossible dt."""
    clocks: dict[int, tuple[np.ndarray, float, frozenset[str]]] = {}  # each judged once
    signals = {}
    for channel, values in raw.channels.items():
        time = raw.clocks.get(channel, raw.time)
        if id(time) not in clocks:
            clocks[id(time)] = _clock(raw, time, len(values))
        signals[channel] = Sampled(clocks[id(time)][0], values, *clocks[id(time)][1:])
    return signals


def _clock(
    raw: RawRecord, time: np.ndarray | None, samples: int
) -> tuple[np.ndarray, float, frozenset[str]]:
    if time is None:
        if raw.dt is None or not 0.0 < raw.dt < np.inf:
            raise ValueError(f"{raw.name}: dt={raw.dt} s must be positive; say data.dt")
        return raw.dt * np.arange(samples), raw.dt, frozenset()
    dt, findings = time_step(time)
    troubles = frozenset(finding.what for finding in findings)
    if not troubles & {"uneven time steps", "dropped samples", "duplicate times"}:
        time = time[0] + dt * np.arange(len(time))
    elif troubles & {"rounded time stamps"}:
        time = even_times(time)
    return time, dt, troubles


def without_duplicates(channels: dict[str, Sampled]) -> tuple[dict[str, Sampled], int]:
    """Channels with the first of all samples that share a time, and how many were left out."""
    kept, most = {}, 0
    for name, signal in channels.items():
        if "duplicate times" in signal.troubles:
            first = np.diff(signal.time, prepend=-np.inf) > 0.0
            most = max(most, int((~first).sum()))
            signal = Sampled(signal.time[first], signal.values[first], signal.dt, signal.troubles)
        kept[name] = signal
    return kept, most


def filled(name: str, channel: str, signal: Sampled, longest: float) -> tuple[Sampled, int, float]:
    """A channel without gaps, the number of its gaps, and the longest [s].

    Measured samples stay as they are. Raises ValueError for gaps above `longest` [s] and at ends.
    """
    place, missing = _missing(signal)
    starts, lengths = runs(missing)
    if not len(starts):
        return signal, 0, 0.0
    seconds = float(lengths.max() * signal.dt)
    at = float(signal.time[0] + signal.dt * starts[lengths.argmax()])
    if missing[0] or missing[-1]:
        raise ValueError(
            f"{name}: {channel} {'begins' if missing[0] else 'ends'} with missing samples, which "
            "cannot be interpolated; cut them off with data.start or data.stop"
        )
    if seconds > longest * (1.0 + 1e-6):
        raise ValueError(
            f"{name}: {channel} has a gap of {seconds:.4g} s at {at:.6g} s, longer than "
            f"data.mend.fill={longest:g} s; raise it, or cut the gap out with data.start or "
            "data.stop"
        )
    return _interpolated(signal, place, missing), len(starts), seconds


def _missing(signal: Sampled) -> tuple[np.ndarray, np.ndarray]:
    """Place (T,) of each sample on a grid without gaps, and where that grid (G,) has no sample."""
    place = np.arange(len(signal.time))
    if "dropped samples" in signal.troubles or "uneven time steps" in signal.troubles:
        steps = np.maximum(np.rint(np.diff(signal.time) / signal.dt), 1.0)
        require_memory(
            16.0 * steps.sum(),
            f"{len(place)} samples with a gap of {steps.max() * signal.dt:.4g} s filled",
            "cut the gap out with data.start or data.stop",
        )
        place[1:] = np.cumsum(steps.astype(np.int64))
    missing = np.ones(int(place[-1]) + 1, dtype=bool)
    missing[place[np.isfinite(signal.values)]] = False
    return place, missing


def _interpolated(signal: Sampled, place: np.ndarray, missing: np.ndarray) -> Sampled:
    from scipy.interpolate import PchipInterpolator  # slow to import

    if "uneven time steps" in signal.troubles:
        time = np.interp(np.arange(len(missing)), place, signal.time)
    else:
        time = signal.time[0] + signal.dt * np.arange(len(missing))
    known = np.isfinite(signal.values)
    values = np.empty(len(missing))
    values[place[known]] = signal.values[known]
    values[missing] = PchipInterpolator(time[place[known]], signal.values[known])(time[missing])
    return Sampled(time, values, signal.dt, signal.troubles)


def resampled(name: str, channels: dict[str, Sampled], rate: float, done: list[str]) -> Channels:
    """All channels on one grid of `rate` [Hz] over their common time.

    Downwards the grid is first a multiple of `rate` no coarser than the fastest sensor; there all
    channels pass the same low-pass, then every m-th sample is kept.
    """
    start = max(float(signal.time[0]) for signal in channels.values())
    stop = min(float(signal.time[-1]) for signal in channels.values())
    wanted = (stop - start) * rate * (1.0 + 1e-9)
    fastest = max(rate, *(1.0 / signal.dt for signal in channels.values()))
    if np.isfinite(wanted):
        require_memory(
            16.0 * len(channels) * max((stop - start) * fastest, 0.0),
            f"{name}: data.mend.resample={rate:g} Hz over {stop - start:.4g} s",
            "lower it, or cut the record with data.start and data.stop",
        )
    count = int(wanted) + 1 if np.isfinite(wanted) else 0
    if stop <= start or count < 2:
        raise ValueError(
            f"{name}: the channels have no common time, the last begins at {start:.4g} s and the "
            f"first ends at {stop:.4g} s; check data.channels.time and data.units.time"
        )
    rates = sorted({float(f"{1.0 / signal.dt:.6g}") for signal in channels.values()})
    m = max(1, int(np.ceil(rates[-1] / rate - 0.01)))
    grid = start + np.arange(m * (count - 1) + 1) / (m * rate)
    grid = np.minimum(grid, stop)  # by an ulp: nothing is extrapolated
    splines = {c: _spline(grid, signal) for c, signal in channels.items()}
    before = " and ".join(f"{r:g}" for r in rates)
    done.append(f"resampled from {before} Hz to {rate:g} Hz, {count} samples, by quintic splines")
    if m == 1:
        return splines
    cutoff = PASS * 0.5 * rate
    smooth = butterworth(name, splines, cutoff, 1.0 / (m * rate), ANTI_ALIAS_ORDER, "low")
    done.append(f"anti-alias low-pass {cutoff:g} Hz before it")
    return {c: x[::m].copy() for c, x in smooth.items()}


def _spline(grid: np.ndarray, signal: Sampled) -> np.ndarray:
    from scipy.interpolate import make_interp_spline  # slow to import

    degree = 5 if len(signal.time) > 5 else 1
    return make_interp_spline(signal.time, signal.values, k=degree)(grid)


def butterworth(
    name: str, channels: Channels, cutoff: float, dt: float, order: int, kind: str
) -> Channels:
    """All channels through one filter there and back. Raises ValueError for short records."""
    from scipy.signal import butter, sosfiltfilt  # slow to import

    sos = butter(order, cutoff, kind, fs=1.0 / dt, output="sos")
    least = 3 * (2 * len(sos) + 1)  # what sosfiltfilt extends a record by
    samples = min(len(x) for x in channels.values())
    if samples <= least:
        raise ValueError(
            f"{name}: {samples} samples are too few for a filter of order {order}, which needs "
            f"more than {least}; lower data.mend.order or leave the filter out"
        )
    return {c: sosfiltfilt(sos, x) for c, x in channels.items()}
