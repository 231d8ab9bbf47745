"""The time step of a clock, and the faults of its times.   T samples."""

from __future__ import annotations

import math

import numpy as np

from data.measured.finding import Finding

HUGE, TINY = 1e30, 1e-30  # s; beyond them no clock counts anything
JITTER = 0.01  # of dt: steps that differ by less are even
ROUGH = 0.1  # of dt: stamps with a finer rounding are not reported
GAP = 1.5  # times dt: longer steps have lost samples
IRREGULAR = 0.2  # of all steps: a clock with more gaps than this has no rate


def time_step(time: np.ndarray) -> tuple[float, list[Finding]]:
    """Median step [s] of a clock (T,) [s], and the faults of that clock.

    Stamps of even samples that were rounded when they were written (0.01, 0.02, 0.02, 0.03 at
    120 Hz) are not taken for uneven samples: their step is the slope of a line through all stamps.
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
    return dt, findings + _suspicious(dt, time)


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
    cause = "the clock started anew or the rows are out of order"
    if any(abs(-steps[at] / full - 1.0) < 0.01 for full in (2**16, 2**32, 4294.967296)):
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
        return float(time[-1] - time[0]) / len(steps), []  # the mean is not quantised
    resolution, slope = _rounding(time, steps)
    if resolution:
        return slope, [_rounded(slope, resolution)] if resolution > ROUGH * slope else []
    dt = dt or _median(time)
    return _gaps_and_jitter(time, steps, dt)


def _gaps_and_jitter(time: np.ndarray, steps: np.ndarray, dt: float) -> tuple[float, list[Finding]]:
    findings = []
    long, same = steps > GAP * dt, steps == 0.0
    if same.any():
        findings.append(_duplicates(time, same))
    if long.mean() > IRREGULAR:
        return dt, [*findings, _uneven(time, steps, dt, steps >= 0.0)]
    even = ~long & ~same
    if np.abs(steps[even] - dt).max() > JITTER * dt:
        resolution, slope = _rounding_of_longest_piece(time, steps, long | same)
        dt = slope if resolution else dt
        if not resolution:
            findings.append(_uneven(time, steps, dt, even))
        elif resolution > ROUGH * dt:
            findings.append(_rounded(dt, resolution))
    else:
        dt = float(steps[even].mean())
    if long.any():
        findings.insert(0, _dropped(time, steps, dt, long))
    return dt, findings


def _rounding_of_longest_piece(
    time: np.ndarray, steps: np.ndarray, breaks: np.ndarray
) -> tuple[float, float]:
    edges = np.concatenate(([-1], np.flatnonzero(breaks), [len(steps)]))
    k = int(np.diff(edges).argmax())
    first, last = int(edges[k]) + 1, int(edges[k + 1])
    return _rounding(time[first : last + 1], steps[first:last])


def _rounding(time: np.ndarray, steps: np.ndarray) -> tuple[float, float]:
    """Resolution [s] of stamps that were rounded, or 0, and the slope of a line through them.

    Rounded stamps take two or three different steps, and stay within their resolution of a line.
    """
    dt = float(steps.mean())
    if not dt > TINY:
        return 0.0, dt
    levels = np.unique(np.rint(steps[:1_000_000] * (1000.0 / dt))) * (dt / 1000.0)
    rare = np.abs(steps - np.median(steps)) > JITTER * dt
    if not 2 <= len(levels) <= 6 or rare.sum() < 3:
        return 0.0, dt
    if rare.mean() <= 0.05 and steps.max() >= GAP * np.median(steps):
        return 0.0, dt  # lost samples instead
    apart = np.diff(levels)
    resolution = float(apart[apart > 0.5 * JITTER * dt].min(initial=levels[-1] - levels[0]))
    middle = np.arange(len(time)) - (len(time) - 1) / 2.0
    slope = float(middle @ time / (middle @ middle))
    off = time - slope * middle
    return (resolution if np.ptp(off) <= 1.2 * resolution else 0.0), slope


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


def _dropped(time: np.ndarray, steps: np.ndarray, dt: float, long: np.ndarray) -> Finding:
    lost = np.rint(steps[long] / dt).astype(int) - 1
    at = int(np.flatnonzero(long)[lost.argmax()])
    gaps = "1 gap" if len(lost) == 1 else f"{len(lost)} gaps, the longest"
    text = (
        f"{gaps} of {lost.max()} samples ({lost.max() * dt:.4g} s) after {time[at]:.6g} s "
        f"(sample {at}); data.mend.fill={_above(lost.max() * dt)} interpolates"
    )
    return Finding("dropped samples", "", text, True)


def _above(seconds: float) -> str:
    """A length with two digits, no shorter than it is."""
    digit = 10.0 ** (math.floor(math.log10(seconds)) - 1)
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


def _suspicious(dt: float, time: np.ndarray) -> list[Finding]:
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
