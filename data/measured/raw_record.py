"""A record as its files hold it: named signals in SI units, with the times of its samples.

T samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from data.arguments import Shown, plain
from data.measured.channels import CHANNEL, signal_of
from data.measured.units import DIMENSIONS, ratios
from data.record import about_samples


@dataclass(frozen=True, repr=False)
class RawRecord(Shown):
    """One record as its files hold it, in SI units, before anything is mended."""

    name: str
    time: np.ndarray | None  # (T,) [s], from the first sample; None: the files have no clock
    dt: float | None  # [s] where the files state it apart from the columns
    channels: dict[str, np.ndarray]  # {"a1": (T,), …} [SI]
    clocks: dict[str, np.ndarray] = field(default_factory=dict)  # of sensors that differ: (T_c,)
    notes: tuple[str, ...] = ()
    whole: bool = True  # False: the rest of a record that was cut in motion
    static: bool = False  # s_dot1, … are zeros that no sensor measured
    unsaid: dict[str, str] = field(default_factory=dict)  # {channel: column} without a unit
    units: dict[str, str] = field(default_factory=dict)  # {channel: unit in the file}

    def __repr__(self) -> str:
        found: dict[str, list[str]] = {}
        for channel in self.channels:
            unit = DIMENSIONS[signal_of(channel)][1] if CHANNEL.fullmatch(channel) else ""
            found.setdefault(unit, []).append(channel)
        samples, dt = max(map(len, self.channels.values()), default=0), self.dt
        if dt is None and (self.clocks or self.time is not None) and samples > 1:
            time = max(self.clocks.values() or [self.own_time()], key=len)
            dt = float(time[-1] - time[0]) / (samples - 1)
        return f"<{plain(self.name)}: {plain(about_samples(samples, dt or None, found))}>"

    def own_time(self) -> np.ndarray:
        """Times (T,) [s] of the samples. Raises ValueError without a clock and a dt."""
        if self.time is not None:
            return self.time
        if self.dt is None:
            raise ValueError(
                f"{self.name} has no clock; name its column (time in data.channels) or say "
                "data.dt in seconds"
            )
        return self.dt * np.arange(len(next(iter(self.channels.values()))))

    @property
    def timed(self) -> bool:
        """Whether the files tell the times of the samples, or the step between them."""
        return bool(self.clocks) or self.time is not None or self.dt is not None

    @property
    def span(self) -> tuple[float, float]:
        """First and last time [s] that all sensors recorded."""
        times = list(self.clocks.values()) or [self.own_time()]
        return max(float(t[0]) for t in times), min(float(t[-1]) for t in times)


def between(raw: RawRecord, start: float, stop: float | None, closed: bool = True) -> RawRecord:
    """The part from `start` to `stop` [s] after the first sample, `stop` included if `closed`.

    Raises ValueError for a part of fewer than two samples, and a clock that does not rise.
    """
    for key, value in (("start", start), ("stop", stop)):
        if value is not None and not np.isfinite(value):
            raise ValueError(
                f"data.{key}={value} must be a time in seconds after the first sample; leave it out"
            )
    if start <= 0.0 and stop is None:
        return raw
    end = np.inf if stop is None else stop

    def part(time: np.ndarray) -> slice:
        if not np.isfinite(time).all() or not (np.diff(time) >= 0.0).all():
            raise ValueError(
                f"{raw.name}: its clock runs backwards or has gaps without a time, so it cannot be "
                "cut; mend the file, or leave time out of data.channels and say data.dt"
            )
        first = int(np.searchsorted(time, start - 1e-9))
        side: Any = "right" if closed else "left"
        last = int(np.searchsorted(time, end + (1e-9 if closed else -1e-9), side=side))
        if last - first < 2:
            raise ValueError(
                f"{raw.name}: from {start:g} s to {end:g} s there are {max(last - first, 0)} "
                f"samples; the record lasts {raw.span[1]:g} s"
            )
        return slice(first, last)

    if raw.clocks:
        cuts = {c: part(clock) for c, clock in raw.clocks.items()}
        clocks = {c: raw.clocks[c][cut] for c, cut in cuts.items()}
        return replace(
            raw, clocks=clocks, channels={c: u[cuts[c]] for c, u in raw.channels.items()}
        )
    time = raw.own_time()
    cut = part(time)
    channels = {c: u[cut] for c, u in raw.channels.items()}
    return replace(raw, time=None if raw.time is None else raw.time[cut], channels=channels)


ROUNDED = 1e-3  # of a signal's deviation: two measurements of one motion differ by more noise


def has_samples_of(
    one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], least: float = 0.5
) -> bool:
    """Whether signals (T,) are a copy of the signals of another record, which may begin elsewhere.

    To rounding, units and constants, as far as both go, at least a share of the copy; not its
    constant channels.
    """
    if not one.keys() <= other.keys():
        return False
    moving = [c for c, x in one.items() if len(x) and np.ptp(x) > 0.0]
    pairs = [(one[c], other[c]) for c in moving]
    ends = [zip(*map(extremes_of, pair), strict=True) for pair in pairs[:1]]
    for late in {0, *(there - here for both in ends for here, there in both)} if pairs else ():
        shifted = [(x[max(-late, 0) :], u[max(late, 0) :], least * len(x)) for x, u in pairs]
        if all(
            min(len(x), len(u)) >= fewest and are_alike(x[: len(u)], u[: len(x)])
            for x, u, fewest in shifted
        ):
            return True
    return False


def extremes_of(x: np.ndarray) -> tuple[int, int]:
    """The samples of the least and the largest finite value."""
    known = np.isfinite(x)
    return int(np.where(known, x, np.inf).argmin()), int(np.where(known, x, -np.inf).argmax())


def are_alike(x: np.ndarray, u: np.ndarray) -> bool:
    """Whether signals (T,) are alike to units, a sign, a constant and rounding; by a few at first.

    Other factors have floors that vibrate in one mode, forces of one pattern, and linear structures
    under one motion in two sizes.
    """
    for step in (max(1, len(x) // 1000), 1):
        known = np.isfinite(x[::step])
        some, others = (one[::step][known] - one[::step][known].mean() for one in (x, u))
        with np.errstate(all="ignore"):  # of absurd values
            factor = (some @ others) / (others @ others)
            rest, apart = some - factor * others, np.abs(np.log(np.abs(factor) / ratios()))
        if not np.abs(rest).max(initial=0.0) <= ROUNDED * some.std() or not apart.min() <= ROUNDED:
            return False
    return True


# A fault of a record, in one line with its place and its remedy.


@dataclass(frozen=True)
class Finding:
    """One fault of a record, and its remedy."""

    what: str  # "dropped samples", "NaN run", "saturation", …
    channel: str  # "" for the clock
    message: str  # one line: values, places in seconds and samples, and the remedy
    blocks: bool = False  # training must not go on unless it is mended

    def __str__(self) -> str:
        return f"{self.what}{f' in {self.channel}' if self.channel else ''}: {self.message}"
