"""Mending of measured records: gaps, clocks, offsets, filters; only on request, and noted.

Every step treats all channels alike, so that what relates excitation to response stays as it was.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from data.measured.channels import signal_of
from data.measured.raw_record import RawRecord
from data.measured.signal_faults import blocking, runs
from data.measured.time_step import even_times, time_step
from data.memory import require_memory

MENDED_BY = {
    "NaN run": "fill",
    "infinite values": "fill",
    "dropped samples": "fill",
    "duplicate times": "fill",
    "uneven time steps": "resample",
    "sensors out of sync": "resample",
    "different rates": "resample",
}


@dataclass(frozen=True)
class Mending:
    """Repairs of a record before anything is fitted; none by default.

    fill: gaps of NaN, infinite or lost samples up to this length are interpolated by PCHIP; of two
    samples at one time the second is omitted.
    resample: to this rate by quintic splines; sensors with clocks of their own come to one grid
    over their common time. To a lower rate, all channels first pass a zero-phase low-pass at 0.8 of
    the new Nyquist frequency.
    low_pass, high_pass: zero-phase Butterworth filters of `order`, there and back, hence −6 dB at
    the cutoff. They look ahead, so training and test parts are to be mended apart.
    """

    resample: float | None = None  # [Hz]
    fill: float | None = None  # [s]
    detrend: str | None = None  # "mean" or "linear"
    low_pass: float | None = None  # [Hz]
    high_pass: float | None = None  # [Hz]
    order: int = 4  # of low_pass and high_pass

    def __post_init__(self) -> None:
        for name in ("resample", "fill", "low_pass", "high_pass"):
            value = getattr(self, name)
            if value is not None and not 1e-12 <= value <= 1e12:
                unit = "s" if name == "fill" else "Hz"
                raise ValueError(
                    f"data.mend.{name}={value} must be positive, from 1e-12 to 1e12 {unit}, or null"
                )
        if self.detrend not in (None, "mean", "linear"):
            raise ValueError(f"data.mend.detrend={self.detrend} must be mean, linear or null")
        if not 1 <= self.order <= 20 or int(self.order) != self.order:
            raise ValueError(f"data.mend.order={self.order} must be a whole number from 1 to 20")
        if self.low_pass and self.high_pass and self.high_pass >= self.low_pass:
            raise ValueError(
                f"data.mend.high_pass={self.high_pass:g} Hz must lie below "
                f"data.mend.low_pass={self.low_pass:g} Hz"
            )

    def __call__(
        self, raw: RawRecord, delays: Mapping[str, float] | None = None
    ) -> tuple[float, Channels, list[str]]:
        """Time step [s], channels (T,) on one even clock, and what was done.

        delays [s]: of channels that come late, by name or signal; of all the common time is left.
        Raises ValueError for what blocks and is not mended, gaps longer than `fill`, cutoffs
        beyond the Nyquist frequency and records too short to filter.
        """
        if not raw.channels or any(len(x) < 2 for x in raw.channels.values()):
            raise ValueError(f"{raw.name}: expected channels of at least 2 samples")
        mended = {f for f, setting in MENDED_BY.items() if getattr(self, setting) is not None}
        blocks = [f for f in blocking(raw) if f.what not in mended]
        if blocks:
            more = f" (and {len(blocks) - 1} more)" if blocks[1:] else ""
            raise ValueError(f"{raw.name}: {blocks[0]}{more}")
        done: list[str] = []
        signals = sampled(raw)
        dt = min(signal.dt for signal in signals.values())
        new_dt = 1.0 / self.resample if self.resample else dt
        self._check_cutoffs(raw.name, new_dt)
        if self.fill is not None:
            signals = _without_gaps(raw.name, signals, self.fill, done)
        late = _shifts(raw.channels, delays or {}, done)
        signals = {c: replace(s, time=s.time - late.get(c, 0.0)) for c, s in signals.items()}
        if self.resample is not None or late:
            said: list[str] = []
            channels = resampled(raw.name, signals, 1.0 / new_dt, said)
            done += said if self.resample is not None else []
        else:
            channels = {name: signal.values for name, signal in signals.items()}
        return new_dt, self._filtered(raw.name, channels, new_dt, done), done

    def _check_cutoffs(self, name: str, dt: float) -> None:
        for setting in ("low_pass", "high_pass"):
            cutoff = getattr(self, setting)
            if cutoff is not None and cutoff >= 0.5 / dt:
                raise ValueError(
                    f"{name}: data.mend.{setting}={cutoff:g} Hz must lie below the Nyquist "
                    f"frequency {0.5 / dt:.4g} Hz; lower it"
                )

    def _filtered(self, name: str, channels: Channels, dt: float, done: list[str]) -> Channels:
        from scipy.signal import detrend as without_trend  # slow to import

        if self.detrend is not None:
            kind = {"mean": "constant", "linear": "linear"}[self.detrend]
            channels = {c: without_trend(x, type=kind) for c, x in channels.items()}
            done.append("mean removed" if self.detrend == "mean" else "linear trend removed")
        for kind, cutoff in (("low", self.low_pass), ("high", self.high_pass)):
            if cutoff is not None:
                channels = butterworth(name, channels, cutoff, dt, self.order, kind)
                done.append(f"{kind}-pass {cutoff:g} Hz, order {self.order} there and back")
        return channels


def _shifts(channels: Channels, delays: Mapping[str, float], done: list[str]) -> dict[str, float]:
    """{channel: seconds that it comes late}, of those that do."""
    each = {c: delays.get(c, delays.get(signal_of(c), 0.0)) for c in channels}
    late = {c: seconds for c, seconds in each.items() if seconds}
    for seconds in dict.fromkeys(late.values()):
        names = ", ".join(c for c in late if late[c] == seconds)
        when = f"{abs(seconds):g} s {'earlier' if seconds > 0.0 else 'later'}"
        done.append(f"{names} shifted to {when}, by quintic splines")
    return late


def _without_gaps(
    name: str, channels: dict[str, Sampled], longest: float, done: list[str]
) -> dict[str, Sampled]:
    """Channels with their gaps interpolated; those with the same gaps are noted together."""
    channels, doubles = without_duplicates(channels)
    if doubles:
        done.append(f"{doubles} samples left out that share a time with another")
    whole, gaps = {}, dict[tuple[int, float], list[str]]()
    for channel, signal in channels.items():
        whole[channel], count, seconds = filled(name, channel, signal, longest)
        if count:
            gaps.setdefault((count, seconds), []).append(channel)
    for (count, seconds), names in gaps.items():
        number = "1 gap of" if count == 1 else f"{count} gaps, the longest"
        done.append(f"{', '.join(names)}: {number} {seconds:.4g} s, interpolated")
    return whole


# Samples with gaps, and sensors with clocks of their own → one even grid.   T samples.
#
# Gaps are filled by PCHIP, which stays between its neighbours where a spline would swing. Rates are
# changed by quintic splines. Relative rms errors of a sine at 1/10 and 1/4 of the sampling rate:
# quintic 3e-6 and 0.2 %, cubic 3e-4 and 1.9 %, PCHIP, which flattens every peak, 1 % and 12 %.

PASS = 0.8  # of the new Nyquist frequency: −6 dB point of the anti-alias filter
ANTI_ALIAS_ORDER = 8
Channels = dict[str, np.ndarray]


@dataclass(frozen=True)
class Sampled:
    """One channel and its times; rounded stamps are replaced by even times."""

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
            f"first ends at {stop:.4g} s; check data.channels.time, data.units.time and data.delay"
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
