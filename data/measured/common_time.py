"""Sensors with clocks of their own: one grid where they share one, alignment where it is asked for.

T samples.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from data.measured.raw_record import RawRecord
from data.measured.time_step import time_step
from data.record import SAME_STEP

ALIGNMENTS = ("start", "motion")
PHASE = 0.02  # of dt: grids that lie closer are one
DRIFT = 0.1  # samples over all: clocks that drift apart by less run alike
UNEVEN = {"uneven time steps", "dropped samples", "duplicate times", "decreasing times", "NaN run"}
LONGEST_LAG = 0.5  # of the shorter of two signals
ALIKE = 0.5  # least correlation of two sensors of one motion


def on_common_grid(raw: RawRecord) -> RawRecord:
    """The samples that all sensors have, where their clocks count one grid; else the record as is.

    A sensor that began earlier or ran longer is in step with the others.
    """
    if len(raw.clocks) < 2:
        return raw
    grids = {}
    for channel, clock in raw.clocks.items():
        dt, findings = time_step(clock)
        if UNEVEN & {finding.what for finding in findings} or not dt > 0.0:
            return raw
        grids[channel] = (float(clock[0]), dt, len(clock))
    if not _one_grid(list(grids.values())):
        return raw
    start, dt = max(t for t, _, _ in grids.values()), next(iter(grids.values()))[1]
    first = {c: round((start - t) / dt) for c, (t, _, _) in grids.items()}
    count = min(n - first[c] for c, (_, _, n) in grids.items())
    if count < 2:
        return raw
    channels = {c: u[first[c] : first[c] + count] for c, u in raw.channels.items()}
    spans = {(round(t, 9), n) for t, _, n in grids.values()}
    notes = raw.notes
    if len(spans) > 1:
        longest = max(n for _, _, n in grids.values())
        notes += (f"the {count} samples that all sensors have, of {longest} of the longest",)
    first_clock = next(iter(raw.clocks))
    time = raw.clocks[first_clock][first[first_clock] :][:count]
    return replace(raw, time=time - time[0], clocks={}, channels=channels, notes=notes)


def _one_grid(grids: list[tuple[float, float, int]]) -> bool:
    start, dt, _ = grids[0]
    for begin, step, samples in grids:
        off = (begin - start) / dt
        if abs(step / dt - 1.0) > min(SAME_STEP, DRIFT / samples):
            return False
        if abs(off - round(off)) > PHASE:
            return False
    return True


def aligned(raw: RawRecord, how: str) -> RawRecord:
    """The record with its sensors' clocks set to one beginning, as `data.align` asks; noted.

    start: each clock begins with its first sample. motion: so shifted besides that each sensor
    correlates best with the first channel; what a structure itself delays goes with it. Raises
    ValueError for a sensor that resembles the first in no way.
    """
    if not raw.clocks:
        return raw
    clocks = {c: clock - clock[0] for c, clock in raw.clocks.items()}
    if how == "start":
        return replace(
            raw,
            clocks=clocks,
            notes=(*raw.notes, "each sensor's clock begins with its first sample"),
        )
    first = next(iter(clocks))
    notes = []
    for channel in list(clocks)[1:]:
        lag = _lag(raw, first, channel, clocks)
        clocks[channel] = clocks[channel] - lag
        notes.append(f"{channel} shifted by {-lag:.6g} s onto {first}")
    origin = min(float(clock[0]) for clock in clocks.values())
    clocks = {c: clock - origin for c, clock in clocks.items()}
    return replace(raw, clocks=clocks, notes=(*raw.notes, *notes))


def _lag(raw: RawRecord, first: str, channel: str, clocks: dict[str, np.ndarray]) -> float:
    """Time [s] by which a channel comes later than the first, a whole number of samples."""
    from scipy.signal import correlate  # slow to import

    dt = max(time_step(clocks[c])[0] for c in (first, channel))
    signals = []
    for c in (first, channel):
        even = np.arange(0.0, clocks[c][-1], dt)
        signal = np.interp(even, clocks[c], np.nan_to_num(raw.channels[c]))
        signal = signal - signal.mean()
        signals.append(signal / (np.linalg.norm(signal) or 1.0))
    one, other = signals
    likeness = correlate(other, one, mode="full", method="fft")
    lags = np.arange(len(likeness)) - (len(one) - 1)
    likeness[np.abs(lags) > LONGEST_LAG * min(len(one), len(other))] = 0.0
    best = int(np.abs(likeness).argmax())
    if abs(likeness[best]) < ALIKE:
        raise ValueError(
            f"{raw.name}: data.align=motion finds nothing of {first} in {channel} (correlation "
            f"{abs(likeness[best]):.2f}, expected {ALIKE} at least); choose data.align=start, or "
            "synchronise the files"
        )
    return float(lags[best] * dt)
