"""Bad samples of a stream: detected, named, and kept from the weights.

    not_finite  a channel is NaN or infinite
    outlier     a value far from all of late, and alone (models/online/outliers.py)
    saturated   an acceleration is at the sensor's full scale
    repeated    an acceleration does not change to the last bit, or a sample came twice
    dropped     samples, or an acceleration, did not come

Inputs keep their last sound value; the estimate stands in for a missing acceleration.
"""

from __future__ import annotations

from collections import Counter, deque
from copy import copy
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import Annotated, Any

import numpy as np
import torch
from torch import Tensor, nn

from data.annotations import Count, Positive, Range, Whole
from data.checked import checked
from data.record import Record
from data.sample import INPUTS, Sample
from data.stream import FAULTS
from models.online.guard_compiled import BEFORE, LARGEST, MEASURED, MISSED, SAME
from models.online.outliers import Ranges, first_is_lone, lone

CHANGING = ["events", "kinds", "still_bad", "bad"]  # in place


@dataclass(frozen=True)
class Event:
    """The first of one or more bad samples in a row, or that after which a model restarted."""

    sample: int  # number, from 0, dropped ones counted
    time: float  # [s]
    kind: str  # dropped, repeated, not_finite, outlier, saturated, restarted or diverged
    channel: str  # a1, f2, …; "all" where the sample did not come, or came twice


@checked
class Guard(nn.Module):
    """Which samples count as bad, and for how long the weights then rest.

    outlier: this many times as far as anything of late, and alone, is one, > 1; None: nothing.
    full_scale: |ẍ| [m/s²] at which a sensor saturates; None: not known.
    repeats: so many values in a row that equal the one before are a fault, ≥ 1; a structure at
    rest, where all is zero, is none. Sensors of few bits repeat themselves: raise it for them.
    longest: gap [samples] that estimates fill; after a longer one the filters begin at rest.
    settle: samples after a fault from which nothing is learnt, while the filters forget it.
    """

    def __init__(
        self,
        full_scale: Positive | None = None,
        repeats: Count = 3,
        longest: Whole = 100,
        settle: Whole = 10,
        outlier: Annotated[float, Range(1, above=True)] | None = 4.0,
    ) -> None:
        super().__init__()
        self.full_scale = inf if full_scale is None else full_scale
        self.repeats, self.outlier = repeats, outlier
        self.longest, self.settle = longest, settle

    def finds(self, record: Record) -> bool:
        """Whether a record holds a bad sample."""
        if not all(torch.isfinite(u).all() for u in record.signals().values()):
            return True
        if float(record.a.abs().max()) >= self.full_scale:
            return True
        moving = (record.a != 0.0).any(-1) | (record.excitation != 0.0).any(-1)
        if self.outlier is not None and self._has_outlier(record, moving):
            return True
        same = (record.a[..., 1:, :] == record.a[..., :-1, :]) & moving[..., 1:, None]
        if record.samples <= self.repeats:
            return False
        return bool(same.unfold(-2, self.repeats, 1).all(dim=-1).any())

    def _has_outlier(self, record: Record, moving: Tensor) -> bool:
        """Whether a record (…, T, ·) holds one."""
        assert self.outlier is not None
        signals = torch.cat(list(record.signals().values()), dim=-1)
        records = signals.reshape(signals.shape[:-2].numel(), *signals.shape[-2:])
        pairs = zip(records, moving.reshape(len(records), -1), strict=True)
        return any(
            lone(signal, when, self.outlier) or first_is_lone(signal, when, self.outlier)
            for signal, when in pairs
        )


class Watch:
    """The state of a guard along one stream. `events` holds the bad samples so far."""

    def __init__(self, guard: Guard, dofs: int, dt: float) -> None:
        self.guard, self.dt = guard, dt
        self.numbers = list(range(1, dofs + 1))  # of the DOFs, in the names of events
        self.events: deque[Event] = deque(maxlen=FAULTS)
        self.kinds: Counter[str] = Counter()  # of all events
        self.sample, self.time = -1, 0.0  # of the newest sample
        self.still_bad: set[tuple[str, str]] = set()  # of the sample before
        self.bad: set[tuple[str, str]] = set()  # of this one
        self.sound: Sample | None = None  # the newest, its inputs mended
        self.unsettled = 0  # samples until something may be learnt again
        self.ranges = Ranges(guard.outlier)
        for i in range(dofs):
            self.ranges.numbers("a", dofs)[BEFORE, i] = nan
        self.replays = 0  # how often samples were gone through again
        self.blind = 0  # samples until an innovation tells about its acceleration again

    def snapshot(self) -> Watch:
        """A watch of its own in the same state."""
        other = copy(self)
        for name in CHANGING:
            setattr(other, name, copy(getattr(self, name)))
        other.ranges = self.ranges.copy()
        return other

    def restore(self, snapshot: Watch) -> None:
        """Go back to the state of a snapshot, which must not be used again."""
        self.__dict__.update(snapshot.__dict__)

    def arrive(self, time: float | None) -> int:
        """Number of samples missing before this one; −1 for a sample that came already.

        A clock may be off by half a sample period at a time. One that goes back by more than a gap
        that is bridged was set again.
        """
        started = self.sample >= 0
        if time is None or not isfinite(time):
            time = self.time + self.dt if started else 0.0
        missed = round((time - self.time) / self.dt) - 1 if started else 0
        came, again = self.sample + 1, missed < -self.guard.longest - 1
        if missed < 0 and not again:
            self._add(Event(self.sample, time, "repeated", "all"))
            return -1
        self.still_bad, self.bad = self.bad, set()
        if missed != 0:
            self._add(Event(came, self.time + self.dt, "dropped", "all"))
            self.unsettled = self.blind = self.guard.settle
        self.sample, self.time = came + max(missed, 0), time
        return self.guard.longest + 1 if again else missed

    def next_time(self, time: float | None) -> float | None:
        """The time of a sample that comes right after the newest one; None of all others."""
        if time is None or not isfinite(time):
            return self.time + self.dt
        return time if round((time - self.time) / self.dt) == 1 else None

    @property
    def repeats(self) -> bool:
        """Whether the samples of an event are gone through again."""
        return self.ranges.limits is not None

    @property
    def waits(self) -> bool:
        """Whether a sample lately was bad, or too few came yet, so that others cannot be judged."""
        ranges = self.ranges
        awaited = ranges.young or ranges.first or ranges.left or self.blind or self.unsettled
        return bool(awaited or self.bad or self.repeats)

    def strays(self, sample: Sample) -> bool:
        """Whether an input of a sample may be an outlier: far off, or the first in motion."""
        signals = ((name, getattr(sample, name)) for name in INPUTS)
        pairs = [(name, u.tolist()) for name, u in signals if u is not None]
        return any(self.ranges.is_first_motion(u) or self.ranges.far(name, u) for name, u in pairs)

    def strays_after(self, a: Tensor, estimate: Tensor) -> bool:
        """Whether an acceleration (n,) may be an outlier: far off, or the first in motion."""
        return self.ranges.is_first_motion(a.tolist()) or bool(self.far(a, estimate))

    def mended(self, sample: Sample, stray: bool) -> Sample:
        """The sample with the last sound values where its own are not finite, or outliers.

        stray: as `strays` says.
        """
        changed: dict[str, Any] = {}
        for name in INPUTS:
            signal = getattr(sample, name)
            if signal is None:
                continue
            values = signal.tolist()
            far = self.ranges.far(name, values) if stray else []
            finite = isfinite(sum(values)) or all(map(isfinite, values))
            kept = values
            if far or not finite:
                changed[name] = self._replace(name, signal, far)
                kept = changed[name].tolist()
            self.ranges.take(
                name, values, kept, [u != v for u, v in zip(values, kept, strict=True)]
            )
        if changed:
            self.blind = self.guard.settle
        self.sound = replace(sample, **changed) if changed else sample
        return self.sound

    def _replace(self, name: str, signal: Tensor, far: list[int]) -> Tensor:
        good = torch.isfinite(signal)
        for i in torch.nonzero(~good).flatten().tolist():
            self._note("not_finite", name, i)
        for i in far:
            if good[i]:
                good[i] = False
                self._note("outlier", name, i)
        held = torch.zeros_like(signal) if self.sound is None else getattr(self.sound, name)
        return torch.where(good, signal, held)

    def far(self, a: Tensor, estimate: Tensor) -> list[int]:
        """DOFs whose acceleration (n,) is an outlier, as far as can be said of it now."""
        errors = None if self.blind else (a - estimate).tolist()
        return self.ranges.far("a", a.tolist(), errors)

    def judge(
        self, a: Tensor | None, sample: Sample, estimate: Tensor, stray: bool
    ) -> tuple[Tensor, bool]:
        """The acceleration (n,) or its replacement, and whether the weights may learn from it.

        stray: as `strays_after` says.
        """
        kept, n = estimate, len(self.numbers)
        values, wrong = [nan] * n, [True] * n
        if a is None:
            self._note("dropped", "a")
        else:
            kept, values, far = a, a.tolist(), self.far(a, estimate) if stray else []
            wrong = [self._wrong(i, u, sample, i in far) for i, u in enumerate(values)]
        if True in wrong:
            kept = torch.where(torch.tensor(wrong), self.bounded(estimate), kept)
        errors = None if self.blind else (kept - estimate).tolist()
        self.ranges.take("a", values, kept.tolist(), wrong, errors)
        self._pass(values, sample)
        if self.bad:
            self.unsettled = self.guard.settle
            return kept, False
        self._compare(values, estimate.tolist(), bool(sample.excitation.any()))
        settled = self.unsettled == 0
        self.unsettled -= not settled
        return kept, settled

    def _pass(self, values: list[float], sample: Sample) -> None:
        """Count a sample down."""
        ranges = self.ranges
        ranges.left -= ranges.left > 0
        self.blind -= self.blind > 0
        if ranges.young and (any(values) or bool(sample.excitation.any())):
            ranges.young -= 1

    def _compare(self, values: list[float], estimates: list[float], moving: bool) -> None:
        """Take a sound sample over into the sums by which a model is compared with none."""
        own = self.ranges.of["a"]
        for i, (value, estimate) in enumerate(zip(values, estimates, strict=True)):
            if moving or value != 0.0:
                error = value - estimate
                own[MISSED, i] += error * error
                own[MEASURED, i] += value * value

    def squares(self) -> tuple[float, float]:
        """Σ (a − â)² and Σ a² of sound samples in motion since they were asked for last."""
        own, channels = self.ranges.of["a"], range(len(self.numbers))
        missed, measured = (sum(own[row, i] for i in channels) for row in (MISSED, MEASURED))
        for i in channels:
            own[MISSED, i] = own[MEASURED, i] = 0.0
        return missed, measured

    def keep_history(self, other: Watch) -> None:
        """Take over the events of another watch, and the number and time of its newest sample."""
        self.events, self.kinds = other.events, other.kinds
        self.sample, self.time, self.replays = other.sample, other.time, other.replays

    def diverge(self) -> None:
        """Name the newest sample as that at which a filter lost the structure."""
        self._add(Event(self.sample, self.time, "diverged", "all"))

    def restart(self) -> None:
        """Name the newest sample as that after which the model is a restarted one."""
        self._add(Event(self.sample, self.time, "restarted", "all"))

    def bounded(self, estimate: Tensor) -> Tensor:
        """An estimate (n,) made finite and limited to the largest acceleration measured so far."""
        own = np.asarray(self.ranges.of["a"])
        largest = torch.tensor(own[LARGEST], dtype=estimate.dtype)
        return torch.nan_to_num(estimate).clamp(-largest, largest)

    def _wrong(self, i: int, value: float, sample: Sample, far: bool) -> bool:
        """Whether the acceleration of DOF i is bad; a repeated value is, unless all is at rest."""
        own, size, kind = self.ranges.of["a"], abs(value), "outlier" if far else ""
        still, own[BEFORE, i] = value == own[BEFORE, i], value
        if not size < self.guard.full_scale:  # NaN too
            own[SAME, i] = 0.0
            kind = "saturated" if isfinite(value) else "not_finite"
        elif still:
            own[SAME, i] += value != 0.0 or bool(sample.excitation.any())
            kind = "repeated" if own[SAME, i] >= self.guard.repeats else kind
        else:
            own[SAME, i] = 0.0
            own[LARGEST, i] = max(own[LARGEST, i], 0.0 if far else size)
        if kind:
            self._note(kind, "a", i)
        return bool(kind)

    def _note(self, kind: str, signal: str, i: int | None = None) -> None:
        number = "" if i is None else self.numbers[i] if signal in "axv" else i + 1
        channel = f"{signal}{number}"
        self.bad.add((kind, channel))
        if (kind, channel) not in self.still_bad:
            self._add(Event(self.sample, self.time, kind, channel))

    def _add(self, event: Event) -> None:
        self.events.append(event)
        self.kinds[event.kind] += 1
