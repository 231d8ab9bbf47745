"""Bad samples of a stream: detected, named, and kept from the weights.

    not_finite  a channel is NaN or infinite
    saturated   an acceleration is at the sensor's full scale
    repeated    an acceleration stands still to the last bit, or a sample came twice
    dropped     samples, or an acceleration, did not come

Inputs keep their last sound value; the estimate stands in for a missing acceleration.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from math import inf, isfinite, nan
from typing import Any

import torch
from torch import Tensor, nn

from data.record import Record
from data.sample import INPUTS, Sample

EVENTS = 1000  # newest ones that are kept: a stream may last for months


@dataclass(frozen=True)
class Event:
    """The first of one or more bad samples in a row."""

    sample: int  # number, from 0, dropped ones counted
    time: float  # [s]
    kind: str  # dropped, repeated, not_finite or saturated
    channel: str  # a1, f2, …; "all" where the sample did not come, or came twice


class Guard(nn.Module):
    """Which samples count as bad, and for how long the weights then rest.

    full_scale: |ẍ| [m/s²] at which a sensor saturates; None: not known.
    repeats: so many values in a row that equal the one before are a fault, ≥ 1; a structure at
    rest, where all is zero, is none. Sensors of few bits repeat themselves: raise it for them.
    longest: gap [samples] that estimates fill; after a longer one the filters begin at rest.
    settle: samples after a fault from which nothing is learnt, while the filters forget it.
    """

    def __init__(
        self,
        full_scale: float | None = None,
        repeats: int = 3,
        longest: int = 100,
        settle: int = 10,
    ) -> None:
        super().__init__()
        if full_scale is not None and not full_scale > 0.0:
            raise ValueError(f"guard.full_scale={full_scale} m/s² must be positive")
        if repeats < 1 or longest < 0 or settle < 0:
            raise ValueError(
                f"guard.repeats={repeats}, longest={longest}, settle={settle}: expected at least "
                "1, 0 and 0 samples"
            )
        self.full_scale = inf if full_scale is None else full_scale
        self.repeats = repeats
        self.longest, self.settle = longest, settle

    def finds(self, record: Record) -> bool:
        """Whether a record holds a bad sample."""
        if not all(torch.isfinite(u).all() for u in record.signals().values()):
            return True
        if float(record.a.abs().max()) >= self.full_scale:
            return True
        moving = (record.a != 0.0).any(-1) | (record.excitation != 0.0).any(-1)
        same = (record.a[..., 1:, :] == record.a[..., :-1, :]) & moving[..., 1:, None]
        if record.samples <= self.repeats:
            return False
        return bool(same.unfold(-2, self.repeats, 1).all(dim=-1).any())


class Watch:
    """The state of a guard along one stream. `events` holds the bad samples so far."""

    def __init__(self, guard: Guard, dofs: int, dt: float) -> None:
        self.guard, self.dt = guard, dt
        self.events: deque[Event] = deque(maxlen=EVENTS)
        self.sample, self.time = -1, 0.0  # of the newest sample
        self.still_bad: set[tuple[str, str]] = set()  # of the sample before
        self.bad: set[tuple[str, str]] = set()  # of this one
        self.sound: Sample | None = None  # the newest, its inputs mended
        self.before = [nan] * dofs
        self.same = [0] * dofs  # values in a row that equal the one before
        self.largest = [0.0] * dofs  # |ẍ| so far
        self.unsettled = 0  # samples until something may be learnt again

    def arrive(self, time: float | None) -> int:
        """Number of samples missing before this one; −1 for a sample that came already.

        A clock may be off by half a sample period at a time. One that goes back by more than a gap
        that is bridged was set anew.
        """
        started = self.sample >= 0
        if time is None or not isfinite(time):
            time = self.time + self.dt if started else 0.0
        missed = round((time - self.time) / self.dt) - 1 if started else 0
        came, anew = self.sample + 1, missed < -self.guard.longest - 1
        if missed < 0 and not anew:
            self.events.append(Event(self.sample, time, "repeated", "all"))
            return -1
        self.still_bad, self.bad = self.bad, set()
        if missed != 0:
            self.events.append(Event(came, self.time + self.dt, "dropped", "all"))
            self.unsettled = self.guard.settle
        self.sample, self.time = came + max(missed, 0), time
        return self.guard.longest + 1 if anew else missed

    def mended(self, sample: Sample) -> Sample:
        """The sample with the last sound values where its own are not finite."""
        changed: dict[str, Any] = {}
        for name in INPUTS:
            signal = getattr(sample, name)
            if signal is not None and not isfinite(sum(signal.tolist())):
                changed[name] = self._held(name, signal)
        self.sound = replace(sample, **changed) if changed else sample
        return self.sound

    def _held(self, name: str, signal: Tensor) -> Tensor:
        finite = torch.isfinite(signal)
        for i in torch.nonzero(~finite).flatten().tolist():
            self._note("not_finite", f"{name}{i + 1}")
        held = torch.zeros_like(signal) if self.sound is None else getattr(self.sound, name)
        return torch.where(finite, signal, held)

    def judged(self, a: Tensor | None, sample: Sample, estimate: Tensor) -> tuple[Tensor, bool]:
        """The acceleration (n,) or its replacement, and whether the weights may learn from it."""
        if a is None:
            self._note("dropped", "a")
            a = torch.full_like(estimate, torch.nan)
            wrong = [True] * len(self.before)
        else:
            values = a.tolist()
            wrong = [self._wrong(i, value, sample) for i, value in enumerate(values)]
            self.before = values
        if True in wrong:
            a = torch.where(torch.tensor(wrong), self.bounded(estimate), a)
        if self.bad:
            self.unsettled = self.guard.settle
            return a, False
        settled = self.unsettled == 0
        self.unsettled -= not settled
        return a, settled

    def bounded(self, estimate: Tensor) -> Tensor:
        """An estimate (n,) made finite and limited to the largest acceleration measured so far."""
        largest = torch.tensor(self.largest, dtype=estimate.dtype)
        return torch.nan_to_num(estimate).clamp(-largest, largest)

    def _wrong(self, i: int, value: float, sample: Sample) -> bool:
        """Whether the acceleration of DOF i is bad; a repeated value is, unless all is at rest."""
        size, still = abs(value), value == self.before[i]
        if size < self.guard.full_scale and not still:  # not NaN either
            self.same[i] = 0
            self.largest[i] = max(self.largest[i], size)
            return False
        if not size < self.guard.full_scale:
            self.same[i] = 0
            self._note("saturated" if isfinite(value) else "not_finite", f"a{i + 1}")
            return True
        self.same[i] += value != 0.0 or bool(sample.excitation.any())
        if self.same[i] < self.guard.repeats:
            return False
        self._note("repeated", f"a{i + 1}")
        return True

    def _note(self, kind: str, channel: str) -> None:
        self.bad.add((kind, channel))
        if (kind, channel) not in self.still_bad:
            self.events.append(Event(self.sample, self.time, kind, channel))
