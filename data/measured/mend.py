"""Mending of measured records: gaps, clocks, offsets, filters; only on request, and noted.

Every step treats all channels alike, so that what relates excitation to response stays as it was.
"""

from __future__ import annotations

from dataclasses import dataclass

from data.measured.finding import Finding
from data.measured.raw_record import RawRecord
from data.measured.resample import (
    Channels,
    Sampled,
    butterworth,
    filled,
    resampled,
    sampled,
    without_duplicates,
)
from data.measured.signal_faults import blocking

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
    samples at one time the second is left out.
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

    def __call__(self, raw: RawRecord) -> tuple[float, Channels, list[str]]:
        """Time step [s], channels (T,) on one even clock, and what was done.

        Raises ValueError for what blocks and is not mended, gaps longer than `fill`, cutoffs
        beyond the Nyquist frequency and records too short to filter.
        """
        if not raw.channels or any(len(x) < 2 for x in raw.channels.values()):
            raise ValueError(f"{raw.name}: expected channels of at least 2 samples")
        blocks = [f for f in blocking(raw) if not self._mends(f)]
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
        if self.resample is not None:
            channels = resampled(raw.name, signals, self.resample, done)
        else:
            channels = {name: signal.values for name, signal in signals.items()}
        return new_dt, self._filtered(raw.name, channels, new_dt, done), done

    def _mends(self, finding: Finding) -> bool:
        setting = MENDED_BY.get(finding.what)
        return setting is not None and getattr(self, setting) is not None

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
