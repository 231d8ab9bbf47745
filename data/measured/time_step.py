"""The time step of a clock, and the faults of its times.   T samples."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from data.measured.raw_record import Finding

HUGE = 1e30  # s; beyond it, and below TINY, no clock counts anything
JITTER = 0.01  # of dt: steps that differ by less are even, and a finer rounding is none
COUNTERS = tuple(2.0**bits * unit for bits in (16, 24, 32) for unit in (1.0, 1e-3, 1e-6))
FULL = (60.0, 3600.0, 43_200.0, 86_400.0, *COUNTERS)  # s; there clocks begin again
ROUGH = 0.1  # of dt: stamps with a finer rounding are not reported
IRREGULAR = 0.2  # of all steps: a clock with more gaps than this has no rate


def time_step(time: np.ndarray) -> tuple[float, list[Finding]]:
    """Step [s] of a clock (T,) [s] as a whole, and the faults of that clock.

    Stamps of even samples that were rounded when they were written (0.01, 0.02, 0.02, 0.03 at
    120 Hz) are not taken for uneven samples: their step is the slope of a line through all stamps.
    A step that is as good as round is taken as round.
    """
    if len(time) < 2:
        return math.nan, [
            Finding("too short", "", f"{len(time)} samples; expected at least 2", True)
        ]
    missing = np.flatnonzero(~np.isfinite(time))
    if len(missing):
        text = f"{len(missing)} times are missing, the first at sample {missing[0]}; {_WITHOUT}"
        return _median(time[np.isfinite(time)]), [Finding("NaN run", "", text, True)]
    if not np.abs(time).max() <= HUGE:
        text = f"times beyond {HUGE:g} s, such as {time[np.abs(time).argmax()]:.6g} s; {_WITHOUT}"
        return _median(time), [Finding("impossible times", "", text, True)]
    steps = np.diff(time)
    if not (steps > 0.0).any() or steps.min() < 0.0:
        return _median(time), [_decreasing(time, steps)]
    dt, findings = _steady(time, steps)
    return dt, findings + step_findings(dt, time)


def unwrapped(time: np.ndarray) -> tuple[np.ndarray, str]:
    """The times (T,) [s] of a clock that begins again, as if it went on, and a remark; else "".

    It begins again when a minute, an hour, half a day, a day or a counter is full: then each step
    back and that period are one step of less than two samples. One that always goes back to its
    first time is of several recordings.
    """
    steps = np.diff(time)
    back, dt = steps < 0.0, _median(time)
    if not back.any() or (time[1:][back] == time[0]).all():
        return time, ""
    for full in FULL:
        on = steps[back] + full
        if (on > 0.0).all() and (on < 2.0 * dt).all() and np.ptp(time) < full + dt:
            times = "once" if len(on) == 1 else f"{len(on)} times"
            return (
                time + full * np.concatenate([[0], np.cumsum(back)]),
                f"the clock begins again after {full:.10g} s, {times}; it is read as if it went on",
            )
    return time, ""


_WITHOUT = "mend the file, or put data.dt in place of its clock"


def _median(time: np.ndarray) -> float:
    steps = np.diff(time)
    forward = steps[steps > 0.0]
    return float(np.median(forward)) if len(forward) else math.nan


def _decreasing(time: np.ndarray, steps: np.ndarray) -> Finding:
    back = np.flatnonzero(steps < 0.0)
    if not len(back):
        text = f"all {len(time)} times are {time[0]:.6g} s; {_WITHOUT}"
        return Finding("duplicate times", "", text, True)
    at = int(back[0])
    cause = "the clock restarted or the rows are out of order"
    if any(abs(-steps[at] / full - 1.0) < 0.01 for full in COUNTERS):
        cause = "the counter ran over"
    text = (
        f"{len(back)} times, the first from {time[at]:.6g} s to {time[at + 1]:.6g} s at sample "
        f"{at + 1} ({cause}); keep one part (data.start, data.stop), or {_WITHOUT}"
    )
    return Finding("decreasing times", "", text, True)


def _steady(time: np.ndarray, steps: np.ndarray) -> tuple[float, list[Finding]]:
    """Time step and unevenness of a clock that never goes back."""
    dt = float(np.median(steps))
    if dt > 0.0 and np.abs(steps - dt).max() <= JITTER * dt:
        return neat(float(time[-1] - time[0]) / len(steps), len(steps)), []
    lattice = lattice_of(time)
    if lattice is None:
        return _gaps_and_jitter(time, steps, dt or _median(time))
    dt = _of_lattice(lattice)
    findings = [_rounded(dt, lattice.resolution)] if lattice.resolution > ROUGH * dt else []
    if lattice.lost.any():
        findings.insert(0, _dropped(time, lattice.lost, dt))
    return dt, findings


def _of_lattice(lattice: Lattice) -> float:
    """Step [s], as round as stamps allow that err by their rounding."""
    samples = int(lattice.places[-1])
    return neat(lattice.dt, samples, 0.3 * lattice.resolution / (samples * lattice.dt))


def neat(dt: float, samples: int, error: float = 0.0) -> float:
    """The round step or rate of a step: 0.01 for 0.009999999999999998.

    Round is what has four digits at most, and drifts by less than a tenth of a sample over all, or
    by less than the relative `error` of the step.
    """
    near = max(error, min(1e-5, max(1e-9, 0.1 / max(samples, 1)))) * dt
    for digits in range(1, 5):
        for step in (float(f"{dt:.{digits}g}"), 1.0 / float(f"{1.0 / dt:.{digits}g}")):
            if abs(step - dt) <= near:
                return step
    return dt


def even_times(time: np.ndarray) -> np.ndarray:
    """Times (T,) [s] of the even samples behind rounded stamps; others unchanged."""
    lattice = lattice_of(time)
    if lattice is None:
        return time
    return time[0] + _of_lattice(lattice) * lattice.places


def _gaps_and_jitter(time: np.ndarray, steps: np.ndarray, dt: float) -> tuple[float, list[Finding]]:
    findings = []
    long, same = steps > GAP * dt, steps == 0.0
    if same.any():
        findings.append(_duplicates(time, same))
    if long.mean() > IRREGULAR:
        dt = _whole(time, dt)
        return dt, [*findings, _uneven(time, steps, dt, steps >= 0.0)]
    even = ~long & ~same
    dt = neat(float(steps[even].mean()), len(steps))
    if np.abs(steps[even] - dt).max() > JITTER * dt:
        findings.append(_uneven(time, steps, dt, even))
    if long.any():
        findings.insert(0, _dropped(time, np.where(long, np.rint(steps / dt) - 1, 0), dt))
    return dt, findings


def _whole(time: np.ndarray, dt: float) -> float:
    """Mean step of the whole clock [s], or `dt` where that mean is none."""
    mean = float(time[-1] - time[0]) / (len(time) - 1)
    return mean if mean > TINY else dt


def _rounded(dt: float, resolution: float) -> Finding:
    text = (
        f"to {resolution:.3g} s; taken as even steps of {dt:.6g} s ({1.0 / dt:.6g} Hz); "
        "say data.dt if you know better"
    )
    return Finding("rounded time stamps", "", text)


def _duplicates(time: np.ndarray, same: np.ndarray) -> Finding:
    at = int(same.argmax())
    text = (
        f"{same.sum()} times occur twice, the first {time[at]:.6g} s at sample {at + 1}; "
        f"data.mend.fill leaves the second out, or {_WITHOUT}"
    )
    return Finding("duplicate times", "", text, True)


def _dropped(time: np.ndarray, lost: np.ndarray, dt: float) -> Finding:
    """Samples that are lost in each step (T − 1,)."""
    at, count = int(lost.argmax()), int((lost > 0).sum())
    most = int(lost[at])
    gaps = "1 gap" if count == 1 else f"{count} gaps, the longest"
    ends = np.concatenate(([-1], np.flatnonzero(lost), [len(time) - 1]))  # last samples of parts
    k = int(np.diff(ends).argmax())
    first, last = float(time[ends[k] + 1] - time[0]), float(time[ends[k + 1]] - time[0])
    keep = [f"data.start={first:.6g}"] * (k > 0) + [f"data.stop={last:.6g}"] * (k < count)
    text = (
        f"{gaps} of {most} samples ({most * dt:.4g} s) after {time[at]:.6g} s "
        f"(sample {at}); {' and '.join(keep)} keeps the longest part without, "
        f"data.mend.fill={above(most * dt)} interpolates"
    )
    return Finding("dropped samples", "", text, True)


def above(seconds: float, digits: int = 2) -> str:
    """A length with two digits, no shorter than it is."""
    digit = 10.0 ** (math.floor(math.log10(seconds)) + 1 - digits)
    return f"{math.ceil(seconds / digit - 1e-6) * digit:.3g}"


def _uneven(time: np.ndarray, steps: np.ndarray, dt: float, even: np.ndarray) -> Finding:
    off = np.where(even, np.abs(steps - dt), 0.0)
    at = int(off.argmax())
    text = (
        f"steps of {steps[even].min():.4g} to {steps[even].max():.4g} s around {dt:.6g} s, the "
        f"worst after {time[at]:.6g} s (sample {at}); data.mend.resample={1.0 / dt:.4g} "
        f"interpolates, or, where only the stamps are uneven, data.dt={dt:.6g} ignores them"
    )
    return Finding("uneven time steps", "", text, True)


def step_findings(dt: float, time: np.ndarray) -> list[Finding]:
    """Steps unlike any sensor's of a structure: the clock counts something else than seconds."""
    if 1e-6 <= dt < 1.0:
        return []
    if dt < TINY:
        text = f"steps of {dt:.4g} s, which no clock has; {_WITHOUT}"
        return [Finding("impossible times", "", text, True)]
    if dt < 1e-6:
        text = f"steps of {dt:.4g} s; if these are days or hours say data.units.time=day or h"
    elif abs(dt - 1.0) < 1e-9 and not (time[:1000] % 1.0).any():
        text = "steps of exactly 1; if these are sample numbers put data.dt in their place"
    else:
        unit, second = ("ms", 1e3) if dt < 500.0 else ("us", 1e6) if dt < 5e5 else ("ns", 1e9)
        text = (
            f"steps of {dt:.6g} s; if these are {unit} say data.units.time={unit} "
            f"({second / dt:.4g} Hz)"
        )
    return [Finding("clock in other unit", "", text)]


# Stamps of even samples that were rounded when they were written.   T samples.
#
# 0.01, 0.02, 0.02, 0.03 at 120 Hz: neither uneven nor doubled.  A file written with a few
# significant digits (five, in many programs) rounds ever more coarsely, by decades of its times.

GAP = 1.5  # times dt: longer steps have lost samples, where rounding does not explain them
MOST_LEVELS = 40  # different steps of rounded stamps, gaps apart
FEWEST = 20  # odd steps that mean a rounding and not lost samples
TINY = 1e-30  # s


@dataclass(frozen=True)
class Lattice:
    """Even samples behind rounded stamps."""

    dt: float  # [s], slope of a line through all stamps
    resolution: float  # [s], the coarsest of the stamps
    places: np.ndarray  # (T,) number of each sample; leaps where samples are lost

    @property
    def lost(self) -> np.ndarray:
        """Samples lost in each step (T − 1,)."""
        return np.diff(self.places) - 1


def lattice_of(time: np.ndarray) -> Lattice | None:
    """The even samples behind stamps (T,) [s] that never go back; None where none explain them."""
    steps = np.diff(time)
    if len(steps) < 8 or not steps.max() > TINY:
        return None
    stamps = np.floor(np.log10(np.maximum(np.abs(time), 0.01))).astype(int) + 2  # decades
    decade, inside = stamps[1:], stamps[1:] == stamps[:-1]
    coarse = np.zeros(len(steps))  # resolution of the stamps around each step
    for value in np.unique(decade[inside]):
        coarse[decade == value] = _resolution(steps[inside & (decade == value)])
    if not coarse.any():
        return None
    coarse[coarse == 0.0] = coarse[coarse > 0.0].min()  # too few stamps to tell
    dt = _mean_step(steps, coarse)
    if dt is None:
        return None
    long = steps > np.maximum(GAP * dt, dt + 1.01 * coarse)
    places = np.concatenate(([0], np.cumsum(np.where(long, np.rint(steps / dt), 1)))).astype(int)
    piece = np.concatenate(([0], np.cumsum(long)))
    dt = _slope(time, places, piece)
    places = _stepped(time, places, piece, dt)
    off = time - dt * places
    if not _explained(off, piece, stamps, np.concatenate((coarse[:1], coarse)), dt):
        return None
    usual = np.median(steps)
    odd = ~long & ((steps > GAP * usual) | (steps < 0.5 * usual))
    if 0 < odd.sum() < FEWEST and float(coarse.max()) > 0.5 * dt:
        return None  # few odd steps among many even ones: lost or doubled samples
    return Lattice(dt, float(coarse.max()), places)


def _resolution(steps: np.ndarray) -> float:
    """What the stamps behind some steps are multiples of [s]; 0 for finer ones than `JITTER`."""
    usual = float(np.median(steps))
    dt = float(steps[steps <= 2.5 * usual].mean()) if usual > 0.0 else float(steps.mean())
    if not dt > TINY:
        return 0.0
    short = steps[steps <= max(3.0 * dt, 1.01 * float(steps[steps > 0.0].min()))][:1_000_000]
    levels = np.unique(np.rint(short * (1000.0 / dt))) * (dt / 1000.0)
    levels = levels[np.concatenate(([True], np.diff(levels) > 0.5 * JITTER * dt))]
    if not 2 <= len(levels) <= MOST_LEVELS:
        return 0.0
    return float(np.diff(levels).min())


def _mean_step(steps: np.ndarray, coarse: np.ndarray) -> float | None:
    """Mean of the steps that have lost no sample."""
    fine = steps[coarse == coarse.min()]
    dt = float(np.median(fine)) or float(fine.mean())
    for _ in range(10):
        kept = steps <= np.maximum(GAP * dt, dt + 1.01 * coarse)
        mean = float(steps[kept].mean()) if kept.any() else 0.0
        if not mean > TINY:
            return None
        if mean == dt:
            break
        dt = mean
    return dt


def _slope(time: np.ndarray, places: np.ndarray, piece: np.ndarray) -> float:
    """Slope of lines through the stamps of all pieces, each with its own offset."""
    count = np.bincount(piece)
    k = places - (np.bincount(piece, places) / count)[piece]
    t = time - (np.bincount(piece, time) / count)[piece]
    return float(k @ t / (k @ k))


def _stepped(time: np.ndarray, places: np.ndarray, piece: np.ndarray, dt: float) -> np.ndarray:
    """Places with the gaps that whole pieces ask for, not one rounded stamp on each side."""
    count = np.bincount(piece)
    middle = np.bincount(piece, time - dt * places) / count
    more = np.rint(np.diff(middle) / dt)
    return places + np.concatenate(([0], np.cumsum(more))).astype(int)[piece]


def _explained(
    off: np.ndarray, piece: np.ndarray, decade: np.ndarray, coarse: np.ndarray, dt: float
) -> bool:
    """Whether stamps leave the line by no more than their rounding, piece by piece."""
    cell = piece * (decade.max() + 1) + decade
    edges = np.flatnonzero(np.diff(cell, prepend=-1))
    spread = np.maximum.reduceat(off, edges) - np.minimum.reduceat(off, edges)
    return bool((spread <= 1.2 * coarse[edges] + JITTER * dt).all())
