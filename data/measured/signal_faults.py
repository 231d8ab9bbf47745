"""Faults of a measured record, each with its place and its remedy.   T samples.

Faults that block would corrupt every estimate; the others are questions to those who know the
sensors.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from data.measured.channels import CHANNEL, signal_of
from data.measured.clocks import clock_findings
from data.measured.plausible import plausibility, unit_findings
from data.measured.raw_record import Finding, RawRecord, are_alike, extremes_of
from data.measured.time_step import above, step_findings
from data.measured.units import DIMENSIONS, GRAVITY

BLOCKS = 20  # of a record, whose means show a drift
ACCELERATIONS = ("a", "s_ddot")
MOTIONS = ("a", "s_ddot", "v", "s_dot", "x", "s")
LARGEST = {  # beyond the range of structures [SI], and the unit that it may be
    "a": (200.0, "cm/s^2 or gal"), "s_ddot": (40.0, "cm/s^2 or gal"),
    "v": (100.0, "mm/s"), "s_dot": (100.0, "mm/s"), "x": (100.0, "mm"), "s": (100.0, "mm"),
    "drift": (100.0, "mm"), "strain": (0.1, "microstrain"),
}  # fmt: skip
SMALLEST = 1e-4  # m/s², peak
PIECE = 65536  # samples
PLATEAU = 8  # samples at one extreme that a sensor's range may have cut off: fewer are spikes
OFFSET = "offset"


def findings(raw: RawRecord) -> list[Finding]:
    """All faults of a record: first those that block, then those that may be intended."""
    clocks = clock_findings(raw)
    first = unit_findings(raw) + [f for f in clocks if f.blocks] + _lacking(raw)
    others = [f for f in clocks if not f.blocks]
    others += list(_zero_first_row(raw))
    kinds = {name: signal_of(name) for name in raw.channels if CHANNEL.fullmatch(name)}
    others += list(_copies(raw, {name: DIMENSIONS[kind][1] for name, kind in kinds.items()}))
    for name, signal in raw.channels.items():
        clock = _clock(raw, name)
        others += channel_findings(name, kinds.get(name, ""), signal, statistics(signal), clock)
    return first + others


def doubts(
    channels: Mapping[str, np.ndarray], dt: float, accelerations: str = "absolute"
) -> list[Finding]:
    """What may be intended in channels [SI] by their names: in each, and in all together."""
    kinds = {name: signal_of(name) for name in channels}
    vibrates = not set(ACCELERATIONS).isdisjoint(kinds.values())
    found = step_findings(dt, dt * np.arange(2)) if vibrates else []
    for name, values in channels.items():
        found += channel_findings(name, kinds[name], values, statistics(values), (0.0, dt))
    return found + plausibility(channels, dt, accelerations)


def blocking(raw: RawRecord) -> list[Finding]:
    """Faults that must be mended before anything is fitted; quick: one pass over each channel."""
    return unit_findings(raw) + [f for f in clock_findings(raw) if f.blocks] + _lacking(raw)


def _lacking(raw: RawRecord) -> list[Finding]:
    faults: list[Finding] = []
    for name, signal in raw.channels.items():
        with np.errstate(all="ignore"):
            whole = np.isfinite(signal.sum())  # only where all of its terms are
        if not whole:
            faults += _missing(name, signal, _clock(raw, name))
    return faults


def channel_findings(
    name: str,
    signal: str,
    values: np.ndarray,
    stats: Statistics,
    clock: tuple[float, float],
) -> list[Finding]:
    """Faults of one channel (T,) [SI] of the signal "a", "x", …, or "" if unknown."""
    if stats.finite < 2:
        return []
    if stats.minimum == stats.maximum:
        text = f"all samples are {stats.minimum:.6g}; "
        text += "take it out of data.channels, or check its wiring"
        return [Finding("constant channel", name, text)]
    faults, saturated = _unit(name, signal, stats), list(_saturation(name, values, stats))
    faults = (faults + saturated) or list(_offset(name, signal, values, stats))
    if signal != "f":  # a hammer is one spike after the other
        faults += _spikes(name, values, stats, clock)
    if signal in MOTIONS:
        faults += _drift(name, values, stats)
    return faults


def _clock(raw: RawRecord, channel: str) -> tuple[float, float]:
    """First time and time step [s] of a channel; 1 where unknown: places are then in samples."""
    clock = raw.clocks.get(channel, raw.time)
    if clock is None or len(clock) < 2:
        return 0.0, raw.dt or 1.0
    return float(clock[0]), float(clock[-1] - clock[0]) / (len(clock) - 1) or 1.0


def _missing(name: str, signal: np.ndarray, clock: tuple[float, float]) -> Iterator[Finding]:
    start, dt = clock
    for what, where in (("NaN run", np.isnan(signal)), ("infinite values", np.isinf(signal))):
        if not where.any():
            continue
        starts, lengths = runs(where)
        longest, at = int(lengths.max()), int(starts[lengths.argmax()])
        text = f"{where.sum()} of {len(signal)} samples in {len(starts)} runs, the longest "
        text += (
            f"{longest} samples ({longest * dt:.4g} s) from {start + at * dt:.6g} s (sample {at}); "
        )
        if len(signal) - where.sum() < 2:
            text += "a fact and no signal; take it out of data.channels"
            yield Finding(what, name, text, True)
            continue
        known = np.flatnonzero(~where)
        ways = [f"data.start={known[0] * dt:.6g}"] if where[0] else []
        ways += [f"data.stop={known[-1] * dt:.6g}"] if where[-1] else []
        cut = f"{' and '.join(ways)} cut{'s' * (len(ways) == 1)} the missing end off"
        inner = np.diff(known).max() - 1
        fill = f"data.mend.fill={above(1.001 * max(inner, 1) * dt, 3)} interpolates"
        text += " and ".join([cut] * bool(ways) + [fill] * bool(inner))
        yield Finding(what, name, text, True)


def _zero_first_row(raw: RawRecord) -> Iterator[Finding]:
    """First row of a logger that was not ready; a quiet structure begins smoothly."""
    channels = raw.channels
    if not channels or any(len(s) < 22 or s[0] != 0.0 for s in channels.values()):
        return
    for name, signal in channels.items():
        usual = np.abs(np.diff(signal[1:22])).max()
        if abs(signal[1]) > 3.0 * usual and usual > 0.0:
            dt = _clock(raw, name)[1]
            text = f"all channels are 0 at the first sample, {name} is {signal[1]:.4g} at the next"
            yield Finding("zero first row", "", f"{text}; data.start={0.5 * dt:.2g} leaves it out")
            return


def _copies(raw: RawRecord, units: Mapping[str, str]) -> Iterator[Finding]:
    """Channels with the samples of one before them, or a multiple, and the same of `units`."""
    seen: dict[tuple[Any, ...], list[str]] = {}
    for name, signal in raw.channels.items():
        key = (units.get(name, ""), len(signal), *sorted(extremes_of(signal)))
        alike = seen.setdefault(key, [])
        first = next((c for c in alike if are_alike(signal, raw.channels[c])), None)
        if first is None:
            alike.append(name)
        elif (np.diff(signal) < 0.0).any():  # no second clock
            text = f"it has the same samples as {first}; leave one of them out of data.channels"
            yield Finding("copied channel", name, text)


def _unit(name: str, signal: str, stats: Statistics) -> list[Finding]:
    peak = max(abs(stats.minimum), abs(stats.maximum))
    largest, guess = LARGEST.get(signal, (np.inf, ""))
    key = f"data.units.{signal}"
    if peak > largest:
        text = f"peak of {peak:.4g} in SI; if it is in {guess} say {key}"
    elif signal in ACCELERATIONS and peak < SMALLEST:
        text = f"peak of {peak:.3g} m/s²; is it in another unit? say {key}"
    elif signal in ACCELERATIONS and abs(abs(stats.mean) - 1.0) < 0.05 and stats.std < 0.5:
        text = f"mean of {stats.mean:.4g} m/s², as gravity in g; if it is in g say {key}=g"
    else:
        return []
    return [Finding("suspicious unit", name, text)]


def _offset(name: str, signal: str, values: np.ndarray, stats: Statistics) -> Iterator[Finding]:
    mean = f"mean of {stats.mean:.4g}"
    if signal in ACCELERATIONS and abs(abs(stats.mean) / GRAVITY - 1.0) < 0.05:
        yield Finding(OFFSET, name, f"{mean} m/s² is gravity; data.mend.detrend=mean removes it")
    elif signal in ACCELERATIONS and _runs_away(values, stats):
        text = "changes the velocity by more than all vibration does; data.mend.detrend=mean"
        yield Finding(OFFSET, name, f"{mean} m/s² {text} removes it")
    elif signal in MOTIONS and signal not in ACCELERATIONS and abs(stats.mean) > 3.0 * stats.std:
        text = f"{mean}, standard deviation {stats.std:.3g}; data.mend.detrend=mean removes it"
        yield Finding(OFFSET, name, text)


def _runs_away(acceleration: np.ndarray, stats: Statistics) -> bool:
    """Whether the mean of an acceleration (T,) changes the velocity by more than all else does."""
    varying = np.nan_to_num(acceleration - stats.mean, posinf=0.0, neginf=0.0)
    return bool(abs(stats.mean) * len(varying) > np.ptp(np.cumsum(varying)))


def _saturation(name: str, values: np.ndarray, stats: Statistics) -> Iterator[Finding]:
    """Many samples at an extreme value and few just below it, unlike the turn of a vibration."""
    for extreme, sign in ((stats.maximum, 1.0), (stats.minimum, -1.0)):
        at = values == extreme
        count = int(np.count_nonzero(at))
        if extreme == 0.0 or not PLATEAU <= count < 0.4 * len(values):  # at rest; two levels only
            continue
        starts, lengths = runs(at)
        below = sign * values
        next_level = below[below < sign * extreme].max()
        edge = max(0.005 * (stats.maximum - stats.minimum), 1.5 * (sign * extreme - next_level))
        near = int(np.count_nonzero(below > sign * extreme - edge)) - count
        if lengths.max() >= 3 and count > 3 * near:
            text = (
                f"{count} samples at {extreme:.6g}, first at sample {starts[0]}, at most "
                f"{lengths.max()} in a row; the sensor's range was too small: cut it out "
                "(data.start, data.stop) or measure again"
            )
            yield Finding("saturation", name, text)


def _spikes(
    name: str, values: np.ndarray, stats: Statistics, clock: tuple[float, float]
) -> Iterator[Finding]:
    """Few samples in a row, far from both neighbours and from almost all others."""
    start, dt = clock
    some = values if stats.finite == len(values) else values[np.isfinite(values)]
    some = some[:: max(1, len(some) // 100_000)]
    middle = float(np.median(some))
    rare = max(1e-3, PLATEAU / len(some))  # share of samples that may be far from the others
    usual = 3.0 * stats.std
    if len(some) >= 1000:
        usual = float(np.quantile(np.abs(some - middle), 1.0 - rare))
    limit = 3.0 * usual
    if limit == 0.0 or max(stats.maximum - middle, middle - stats.minimum) <= limit:
        return
    with np.errstate(invalid="ignore"):
        far = np.sign(values - middle) * (np.abs(values - middle) > limit)
    starts, lengths = np.concatenate([runs(far > 0.0), runs(far < 0.0)], axis=1)
    ends = starts + lengths  # behind the last
    inside = (starts > 0) & (ends < len(values)) & (lengths < PLATEAU)
    starts, ends = starts[inside], ends[inside]
    beside = np.stack((values[starts] - values[starts - 1], values[ends - 1] - values[ends]))
    alone = (np.abs(beside) > 2.0 * usual).all(axis=0) & (beside[0] * beside[1] > 0.0)
    starts, ends = starts[alone], ends[alone]
    if 0 < len(starts) <= max(1, 1e-3 * len(values)):
        at = int(starts[np.abs(values[starts] - middle).argmax()])
        longest = int((ends - starts).max())
        text = (
            f"{int((ends - starts).sum())} samples far from all others, at most {longest} in a "
            f"row, the largest {values[at]:.4g} at {start + at * dt:.6g} s (sample {at}); unless "
            "these are impacts, leave their cells empty in the file and set "
            f"data.mend.fill={above(1.001 * longest * dt, 3)}"
        )
        yield Finding("spike", name, text)


def _drift(name: str, values: np.ndarray, stats: Statistics) -> Iterator[Finding]:
    """Means of blocks that lie on a line which climbs by more than half a deviation."""
    size = len(values) // BLOCKS
    if size < 10 or stats.finite < len(values):
        return
    means = values[: BLOCKS * size].reshape(BLOCKS, size).mean(axis=1)
    place = np.linspace(-0.5, 0.5, BLOCKS)
    climb = float(place @ means / (place @ place))
    left = means - means.mean() - climb * place
    if abs(climb) > 0.5 * stats.std and left.var() < 0.1 * means.var():
        text = (
            f"the mean moves by {climb:.4g} from beginning to end, standard deviation "
            f"{stats.std:.3g}; unless the structure did so, data.mend.detrend=linear or "
            "data.mend.high_pass removes it"
        )
        yield Finding("drift", name, text)


# Statistics of a channel, and runs of samples within it.   T samples.


@dataclass(frozen=True)
class Statistics:
    """Statistics of the finite samples of a channel, in its unit."""

    minimum: float
    maximum: float
    mean: float
    std: float
    finite: int
    nans: int
    infinite: int


def statistics(signal: np.ndarray) -> Statistics:
    """Range, mean and deviation of a channel (T,), without what is not finite."""
    finite = signal
    nans = infinite = 0
    if not np.isfinite(signal.min(initial=0.0) + signal.max(initial=0.0)):
        nans = int(np.isnan(signal).sum())
        infinite = int(np.isinf(signal).sum())
        finite = signal[np.isfinite(signal)]
    if not len(finite):
        return Statistics(np.nan, np.nan, np.nan, np.nan, 0, nans, infinite)
    mean, std = float(finite.mean()), _deviation(finite)
    low, high = float(finite.min()), float(finite.max())
    return Statistics(low, high, mean, std, len(finite), nans, infinite)


def _deviation(signal: np.ndarray) -> float:
    """Standard deviation, in pieces that stay in the cache."""
    mean, total = signal.mean(), 0.0
    for start in range(0, len(signal), PIECE):
        piece = signal[start : start + PIECE] - mean
        total += float(piece @ piece)
    return float(np.sqrt(total / len(signal)))


def runs(where: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Starts and lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(where.astype(np.int8), prepend=0, append=0))
    return edges[::2], edges[1::2] - edges[::2]
