"""Where a record begins to move after a quiet start, its offsets, and where it is let go.

T samples.

A start is quiet while no channel stirs: no response, and no excitation.  What comes later is never
looked at, so that a training motion's beginning does not depend on its end.
"""

from __future__ import annotations

from bisect import insort
from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np

from data.measured.channels import numbered, signal_of
from data.measured.raw_record import RawRecord

BLOCK = 0.25  # s
FEWEST = 16  # samples of a block
RISE = 20.0  # times the deviation of the blocks before
QUIET = 4  # blocks at least that are compared with
SHORTEST = 1.0  # s, the least that is worth cutting
KEPT = 0.5  # s of rest that stay before the onset
STILL = ("a", "v", "s_ddot", "s_dot")  # signals that are zero at rest: what they show is an offset,
ALONE = "x"  # and displacements without the others of a DOF, whose motion begins at their zero


def onset_of(channels: Mapping[str, np.ndarray], dt: float) -> int:
    """Sample at which the first channel begins to move; 0 where the record begins in motion."""
    size = max(FEWEST, round(BLOCK / dt))
    starts = [_onset(signal, size) for signal in channels.values()]
    found = [start for start in starts if start is not None]
    # channels that never rise are noise throughout if others do by far
    return min(found) * size if len(found) > len(starts) / 2 else 0


def _onset(signal: np.ndarray, size: int) -> int | None:
    """First block (of `size` samples) that rises far above all before it, None without one."""
    count = len(signal) // size
    if count <= QUIET:
        return None
    blocks = signal[: count * size].reshape(count, size)
    deviation = blocks.std(axis=1).tolist()
    moved = np.abs(blocks.mean(axis=1) - blocks[0].mean()).tolist()
    rising = sorted(deviation[:QUIET])
    farthest = max(moved[1:QUIET])  # a slow test moves from its first block on
    for k in range(QUIET, count):
        before = 0.5 * (rising[(k - 1) // 2] + rising[k // 2])  # the median
        if deviation[k] > RISE * before or moved[k] > RISE * max(before, farthest):
            return k
        insort(rising, deviation[k])
        farthest = max(farthest, moved[k])
    return None


def without_quiet_start(raw: RawRecord) -> RawRecord:
    """The record from shortly before its onset on, with a note; as it is where none is quiet."""
    if raw.clocks or not raw.timed:
        return raw
    time = raw.own_time()
    if len(time) < 2 or not np.isfinite(time).all() or not (np.diff(time) > 0.0).all():
        return raw
    known = {c: u for c, u in raw.channels.items() if np.isfinite(u).all() and np.ptp(u) > 0.0}
    dt = float(time[-1] - time[0]) / (len(time) - 1)
    if not known or len(known) < len(raw.channels):
        return raw
    first = onset_of(known, dt) - round(KEPT / dt)
    if first * dt < SHORTEST or len(time) - first < 2:
        return raw
    note = f"quiet until {(first * dt) + KEPT:.4g} s: the first {first * dt:.4g} s cut off"
    signals = set(map(signal_of, known))
    still = STILL if signals & {"a", "v"} else (*STILL, ALONE)
    rest = {c: float(u[:first].mean()) for c, u in known.items() if signal_of(c) in still}
    if rest:
        shown = ", ".join(f"{c} {offset:.3g}" for c, offset in rest.items())
        note += f"; offsets of the quiet part subtracted (SI): {shown}"
    return _from_sample(raw, first, note, rest)


def _from_sample(raw: RawRecord, first: int, note: str, rest: Mapping[str, float]) -> RawRecord:
    """The record from a sample on, with a note; rest: offsets by channel that are subtracted."""
    later = None if raw.time is None else raw.time[first:]
    channels = {c: u[first:] - rest.get(c, 0.0) for c, u in raw.channels.items()}
    return replace(raw, time=later, channels=channels, notes=(*raw.notes, note))


# Free vibrations: a structure is pulled and let go, or struck, and rings down.

DRIVES = ("f", "s", "s_dot", "s_ddot")  # signals that drive a motion
PIECES = 5  # of a record, each of which moves less than the one before
HELD = 0.1  # times the motion after a release: what is held moves less
MOSTLY = 0.8  # of the time before a release
TURNS = 4  # zero crossings: a ring-down of several modes is largest in its first two cycles


def _response(channels: Mapping[str, np.ndarray]) -> np.ndarray:
    """Accelerations (T, c), else velocities or steps of displacements, over their deviations."""
    for signal in ("a", "v", "x"):
        found = [channels[f"{signal}{i}"] for i in numbered(channels, signal)]
        if found:
            moved = np.stack(found, axis=1)
            moved = np.diff(moved, axis=0, append=moved[-1:]) if signal == "x" else moved
            moved = moved - np.median(moved, axis=0)
            return np.asarray(moved / np.maximum(moved.std(axis=0), 1e-300))
    return np.zeros((0, 1))


def release(channels: Mapping[str, np.ndarray]) -> int | None:
    """Sample from which a motion (T,) that nothing drives rings down; None where it does not.

    The largest motion comes first, or after a time in which the structure is held; from there on it
    falls piece by piece. An earthquake is largest after many cycles.
    """
    moved = _response(channels)
    size = np.abs(moved).max(axis=1, initial=0.0)
    if len(size) < PIECES or not size.any():
        return None
    first, largest = divmod(int(np.abs(moved).argmax()), moved.shape[1])
    after = size[first : first + max(1, (len(size) - first) // PIECES)]
    held = first > 0 and np.quantile(size[:first], MOSTLY) < HELD * (after**2).mean() ** 0.5
    turns = np.count_nonzero(np.diff(np.sign(moved[: first + 1, largest])))
    start = first if held else 0
    pieces = [
        float((piece**2).mean()) for piece in np.array_split(size[start:], PIECES) if len(piece)
    ]
    falls = all(b < max(a, HELD**2 * pieces[0]) for a, b in pairwise(pieces))  # to its noise
    return start if (held or turns <= TURNS) and falls else None


def from_release(raw: RawRecord) -> RawRecord:
    """A free vibration from where it is let go; as it is where something drives the motion."""
    driven = any(numbered(raw.channels, d) for d in (*DRIVES, "r"))
    if driven or raw.clocks or not all(np.isfinite(u).all() for u in raw.channels.values()):
        return raw
    first = release(raw.channels)
    if not first:
        return raw
    note = f"free vibration from its largest motion on: the first {first} samples cut off"
    return _from_sample(raw, first, note, {})
