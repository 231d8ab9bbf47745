"""Tests of elements cycle by cycle: without a clock there are no rates, and a cycle is cut whole.

T samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from data.measured.channels import numbered, signal_of
from data.measured.raw_record import RawRecord

WITHOUT = (
    "an element test without a clock is quasi-static: forces depend on the order of deformations "
    "alone; say data.dt where rates matter"
)


def needs_no_clock(channels: Iterable[str]) -> bool:
    """Whether channels are a test of an element that tells of no rate: s1, r1, other inputs."""
    signals = set(map(signal_of, channels))
    return "s" in signals and signals <= {"s", "r", "u"}


def without_rates(raw: RawRecord, wanted: bool | None = None) -> RawRecord:
    """An element test without rates, where that is wanted, or where no clock tells of rates.

    Its forces then depend on the order of the deformations alone: samples count as 1 s apart, and
    the rates are zero. None: where neither the files nor the user name a clock, a dt or a rate.
    """
    moved = numbered(raw.channels, "s")
    static = not raw.timed and needs_no_clock(raw.channels) if wanted is None else wanted and moved
    if not static:
        return raw
    rates = {f"s_dot{i}": np.zeros_like(raw.channels[f"s{i}"]) for i in moved}
    said = "quasi-static, as data.quasi_static says: no rates"
    notes = (*raw.notes, WITHOUT if wanted is None else said)
    dt, channels = raw.dt if raw.timed else 1.0, raw.channels | rates
    return replace(raw, dt=dt, channels=channels, notes=notes, static=True)


def is_quasi_static(channels: Mapping[str, np.ndarray]) -> bool:
    """Whether channels (T,) are the test of an element whose rates were left out."""
    return "r1" in channels and "s_dot1" in channels and not channels["s_dot1"].any()


CYCLE = 0.02  # of the range of a deformation: a turn back by less ends no cycle


def valleys(s: np.ndarray) -> np.ndarray:
    """Samples (k,) at which a deformation (T,) turns from down to up: there a cycle ends."""
    band, found = CYCLE * float(np.ptp(s)), list[int]()
    side, furthest = 0, 0
    for k, now in enumerate(s):
        back = now - s[furthest]
        if side * back >= 0.0 and (side or abs(back) <= band):
            furthest = k if side else furthest
        elif abs(back) > band:
            found += [furthest] if side < 0 else []
            side, furthest = (1 if back > 0.0 else -1), k
    return np.array(found, dtype=int)


def end_of_a_cycle(s: np.ndarray, share: float) -> int | None:
    """Sample near a share of a cyclic test (T,) that ends a cycle; None of fewer than two cycles.

    Deformations behind it are no larger than those before where any such sample makes them so;
    else the last cycle is behind it.
    """
    ends = valleys(s)[:-1]
    ends = ends[ends > 1]
    if not len(ends):
        return None
    slack = CYCLE * float(np.ptp(s))
    before = np.minimum.accumulate(s), np.maximum.accumulate(s)
    behind = (u.accumulate(s[::-1])[::-1] for u in (np.minimum, np.maximum))
    low, high = ((b - a)[ends] for a, b in zip(before, behind, strict=True))
    inside = ends[(low >= -slack) & (high <= slack)]
    if not len(inside):
        return int(ends[-1])
    return int(inside[np.abs(inside - share * len(s)).argmin()])
