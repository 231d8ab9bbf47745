"""Faults of the clocks of a record, of each and of all together.   T samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from data.measured.channels import CHANNEL
from data.measured.cycles import WITHOUT, needs_no_clock
from data.measured.raw_record import Finding, RawRecord
from data.measured.time_step import time_step
from data.record import SAME_STEP


def clock_findings(raw: RawRecord) -> list[Finding]:
    """Faults of the clocks of a record, of each and of all together."""
    if raw.clocks:
        return list(_of_own_clocks(raw))
    lengths = {name: len(signal) for name, signal in raw.channels.items()}
    lengths |= {} if raw.time is None else {"time": len(raw.time)}
    findings: list[Finding] = []
    if len(set(lengths.values())) > 1:
        text = f"{_listed(lengths)} samples; name the clock of each file in data.channels.time"
        findings.append(Finding("unequal lengths", "", text, True))
    if raw.time is not None:
        dt, faults = time_step(raw.time)
        findings += faults
        if raw.dt is not None and abs(dt / raw.dt - 1.0) > 0.01:
            text = f"steps of {dt:.6g} s, but the file says dt={raw.dt:.6g} s; say data.units.time"
            findings.append(Finding("clock in other unit", "", text))
    elif raw.dt is None:
        text = "the times of the samples are unknown; say data.dt or data.channels.time"
        free = needs_no_clock(c for c in raw.channels if CHANNEL.fullmatch(c))
        findings.append(Finding("no clock", "", WITHOUT if free else text, not free))
    return findings


def _of_own_clocks(raw: RawRecord) -> Iterator[Finding]:
    """Findings of sensors with clocks of their own; channels that share a clock are one."""
    shared = shared_clocks(raw.clocks)
    steps, starts, ends = {}, {}, {}
    for channels in shared:
        clock, names = raw.clocks[channels[0]], ", ".join(channels)
        steps[names], faults = time_step(clock)
        starts[names], ends[names] = float(clock[0]), float(clock[-1])
        for fault in faults:
            yield Finding(fault.what, "", f"{names}: {fault.message}", fault.blocks)
    if len(shared) < 2:
        return
    near = max(steps.values()) < 1.01 * min(steps.values())  # one rate by clocks that run unlike
    rate = 1.0 / (min(steps.values()) if near else max(steps.values()))
    remedy = f"data.mend.resample={rate:.4g} interpolates all to one clock"
    length = max(ends.values()) - min(starts.values())
    drift = length * (max(steps.values()) / min(steps.values()) - 1.0)
    apart = drift > DRIFT * min(steps.values())
    if apart:
        rates = _listed({name: f"{1.0 / dt:.5g} Hz" for name, dt in steps.items()})
        text = f", which drift apart by {drift:.3g} s in {length:.4g} s" if near else ""
        yield Finding("different rates", "", f"{rates}{text}; {remedy}", True)
    begun = max(starts.values()) - min(starts.values())
    if apart and begun <= PHASE * min(steps.values()):
        return
    if max(starts.values()) >= min(ends.values()):
        text = _no_common_time(starts, ends)
        yield Finding("no common time", "", text, True)
        return
    late = _listed({name: f"{start:.4g} s" for name, start in starts.items()})
    yield Finding("sensors out of sync", "", f"first samples at {late}; {remedy}", True)


def require_common_time(raw: RawRecord) -> None:
    """Raise ValueError for sensors none of whose samples were taken in the same time."""
    starts = {name: float(clock[0]) for name, clock in raw.clocks.items() if len(clock)}
    ends = {name: float(raw.clocks[name][-1]) for name in starts}
    if starts and max(starts.values()) >= min(ends.values()):
        raise ValueError(f"{raw.name}: no common time: {_no_common_time(starts, ends)}")


def _no_common_time(starts: Mapping[str, float], ends: Mapping[str, float]) -> str:
    last, first = max(starts, key=lambda n: starts[n]), min(ends, key=lambda n: ends[n])
    return (
        f"{last} begins at {starts[last]:.6g} s, when {first} has ended at {ends[first]:.6g} s: "
        "their counters have no common zero; if all began together say data.align=start, or "
        "data.align=motion, which shifts each onto the first by its likeness"
    )


def with_own_clocks(raw: RawRecord) -> RawRecord:
    """The record with clocks of their own for channels that fill every second, third, … row only.

    Such are sensors of a lower rate in one table with others.
    """
    if raw.clocks or not raw.timed:
        return raw
    time, rows = raw.own_time(), {}
    for channel, values in raw.channels.items():
        rows[channel] = np.flatnonzero(np.isfinite(values))
        steps = np.diff(rows[channel])
        every = int(np.median(steps)) if len(steps) else 1
        if every < 2 or np.mean(steps == every) < REGULAR or len(values) != len(time):
            rows[channel] = np.arange(len(values))
    slow = [channel for channel, kept in rows.items() if len(kept) < len(time)]
    if not slow or not np.isfinite(time).all():
        return raw
    clocks = {channel: time[kept] for channel, kept in rows.items()}
    channels = {channel: raw.channels[channel][kept] for channel, kept in rows.items()}
    note = f"{', '.join(slow)}: empty cells between the samples of a lower rate"
    return replace(raw, time=None, clocks=clocks, channels=channels, notes=(*raw.notes, note))


def shared_clocks(clocks: Mapping[str, np.ndarray]) -> list[list[str]]:
    """Channels in groups that have the same times."""
    shared: list[list[str]] = []
    for channel, clock in clocks.items():
        same = (g for g in shared if np.array_equal(clocks[g[0]], clock, equal_nan=True))
        group = next(same, None)
        if group is None:
            shared.append([channel])
        else:
            group.append(channel)
    return shared


def _listed(values: Mapping[str, object]) -> str:
    shown = ", ".join(f"{name} {value}" for name, value in list(values.items())[:6])
    return shown + (", …" if len(values) > 6 else "")


# Sensors with clocks of their own: one grid where they share one, alignment where it is asked for.
#
# T samples.

ALIGNMENTS = ("start", "motion")
PHASE = 0.02  # of dt: grids that lie closer are one
DRIFT = 0.1  # samples over all: clocks that drift apart by less run alike
UNEVEN = {"uneven time steps", "dropped samples", "duplicate times", "decreasing times", "NaN run"}
LONGEST_LAG = 0.5  # of the shorter of two signals
REGULAR = 0.9  # of the steps of a slower channel are of one number of rows
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
        note = "each sensor's clock begins with its first sample"
        return replace(raw, clocks=clocks, notes=(*raw.notes, note))
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
