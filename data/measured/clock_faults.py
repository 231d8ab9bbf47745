"""Faults of the clocks of a record, of each and of all together.   T samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from data.measured.finding import Finding
from data.measured.raw_record import RawRecord
from data.measured.time_step import time_step


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
        findings.append(Finding("no clock", "", text, True))
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
    rate = 1.0 / max(steps.values())
    remedy = f"data.mend.resample={rate:.4g} interpolates all to one clock"
    apart = max(steps.values()) > 1.001 * min(steps.values())
    if apart:
        rates = _listed({name: f"{1.0 / dt:.5g} Hz" for name, dt in steps.items()})
        yield Finding("different rates", "", f"{rates}; {remedy}", True)
    if apart and len(set(starts.values())) == 1:
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
