"""Outliers: samples far from all of late, and alone. What lasts is an event, however sudden.

A value is far off where its step from the value before, and its innovation, together exceed those
of late: |Δu| |e| > times² max|Δu| max|e|, both maxima fading in FADE samples. Rejecting by the
innovation is the recursive least M-estimate of Zou, Chan & Ng (2000), with the hard limit of
Hampel's identifier; the largest of late replaces their median, as innovations of sound data
come in bursts. Whether a far value was alone is known some samples later
(`models/online/stream.py`).

The first samples in motion have nothing before them. They are taken unchanged and judged once
there are enough: the same product, with the distance from the median as the step, is then compared
with the largest of all the others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from itertools import pairwise
from math import inf, isfinite
from statistics import median
from typing import Any

import numpy as np
import torch
from torch import Tensor

from models.online.guard_compiled import (
    ERROR,
    FADE,
    KEPT,
    LAST,
    LEVEL,
    ROWS,
    STEP,
    far,
    take,
)

YOUNG = 20  # first samples in motion, judged together; FADE at most, for a structure may rest again
WINDOW = 12  # samples in which a far value may prove the first of an event, itself counted
EVENT = 5  # values out of the ordinary among them, of one channel, from which on it is one
NEWEST = 3  # values that nothing came after yet that could be compared
BEYOND = 2.0  # times the largest of late is out of the ordinary: sound data grow by less

Channel = tuple[str, int]  # signal and place in it
Limits = dict[Channel, tuple[float, float]]  # sound values lie around the first, by the second


class Ranges:
    """The ranges of all channels along one stream, and how many samples after an outlier it is.

    times: None judges nothing. The innovation of a channel is judged, of an input its size.
    """

    def __init__(self, times: float | None) -> None:
        self.times = times
        self.of: dict[str, memoryview[float]] = {}  # rows and channels of a signal
        self.young = YOUNG  # samples in motion that are still to come
        self.left = 0  # samples of the window behind an outlier that are still to come
        self.window: dict[Channel, list[float]] = {}  # values in it, by channel
        self.unusual: dict[Channel, int] = {}  # how many of them are out of the ordinary
        self.first = False  # whether the window is that of the first samples in motion
        self.limits: Limits | None = None  # while samples are gone through again

    def copy(self) -> Ranges:
        """Ranges of their own that are equal."""
        other = copy(self)
        other.of = {name: _view(np.array(numbers)) for name, numbers in self.of.items()}
        other.window = {channel: list(sizes) for channel, sizes in self.window.items()}
        other.unusual = dict(self.unusual)
        return other

    def far(
        self, name: str, values: Sequence[float], errors: Sequence[float] | None = None
    ) -> list[int]:
        """Channels of a signal whose values are far off."""
        if self.limits is not None:
            limits = (self.limits.get((name, i), (0.0, inf)) for i in range(len(values)))
            pairs = enumerate(zip(values, limits, strict=True))
            return [i for i, (u, (middle, radius)) in pairs if abs(u - middle) > radius]
        if self.times is None or self.young or self.first:
            return []
        numbers, times = self.numbers(name, len(values)), self.times
        sizes, usual = (values, LEVEL) if errors is None else (errors, ERROR)
        return [
            i for i, value in enumerate(values) if far(value, sizes[i], usual, numbers, i, times)
        ]

    def take(
        self,
        name: str,
        values: Sequence[float],
        kept: Sequence[float],
        wrong: Sequence[bool] | None = None,
        errors: Sequence[float] | None = None,
    ) -> None:
        """Take over a signal's measured values and those that were kept instead of wrong ones."""
        numbers = self.numbers(name, len(values))
        for i, value in enumerate(values):
            if (self.left or self.first) and isfinite(value):
                self.window.setdefault((name, i), []).append(value)
            if self.left:
                step, usual = abs(value - numbers[LAST, i]), BEYOND * numbers[STEP, i]
                if step > usual or abs(value) > BEYOND * numbers[LEVEL, i]:
                    self.unusual[name, i] = self.unusual.get((name, i), 0) + 1
            elif not (wrong is not None and wrong[i]):
                take(kept[i], numbers, i)
                if errors is not None and isfinite(errors[i]):
                    numbers[ERROR, i] = max(abs(errors[i]), KEPT * numbers[ERROR, i])
            numbers[LAST, i] = kept[i]

    def event(self) -> Limits | None:
        """None unless what seemed an outlier lasts; then the limits of the channels in the event.

        What exceeds by far all that came after it, in the event itself, is no part of it.
        """
        if self.times is None or max(self.unusual.values(), default=0) < EVENT:
            return None
        much = self.times**2
        window = {channel: list(map(abs, values)) for channel, values in self.window.items()}
        for sizes in window.values():
            newest, before = max(sizes[-NEWEST:]), max(sizes[:-NEWEST], default=0.0)
            if self.left and newest > much * before > 0.0:
                return None  # let us see what comes after it
        return {channel: (0.0, much * _of_event(u, much)) for channel, u in window.items()}

    def is_first_motion(self, values: Sequence[float]) -> bool:
        """Whether a signal's values are the first in motion."""
        return self.times is not None and self.young > 0 and not self.first and any(values)

    def of_first(self) -> Limits | None:
        """Limits of channels with outliers among the first samples; None: not known yet."""
        if self.times is None or self.young:
            return None
        return limits_of_first(self.window, self.times)

    def watch(self) -> None:
        """Begin the window behind an outlier, or that of the first samples in motion."""
        self.first = self.young > 0
        self.left, self.window, self.unusual = 0 if self.first else WINDOW, {}, {}

    def numbers(self, name: str, channels: int) -> memoryview[float]:
        """The rows of guard_compiled.py for the channels of a signal, changed in place.

        A view of an array, which compiled code shares: Python has its numbers as floats.
        """
        if name not in self.of:
            self.of[name] = _view(np.zeros((len(ROWS), channels)))
        return self.of[name]


def _view(numbers: np.ndarray) -> memoryview[float]:
    view: memoryview[Any] = numbers.data
    return view


def _of_event(sizes: Sequence[float], much: float) -> float:
    """The largest of some values in a row, without those that fall off much to all after them."""
    largest = max(sizes[-NEWEST:])
    for size in reversed(sizes[:-NEWEST]):
        if size <= much * largest:
            largest = max(largest, size)
    return largest or inf


def limits_of_first(window: Mapping[Channel, Sequence[float]], times: float) -> Limits | None:
    """Limits of the channels whose first values hold outliers; None: let us see what comes after.

    An onset is distinguished from an outlier by what follows it.
    """
    limits: Limits = {}
    for channel, values in window.items():
        middle = median(values)
        found, radius = _far_from_others(values, middle, times)
        if found and max(found) >= len(values) - WINDOW:
            return None
        if found:
            limits[channel] = middle, radius
    return limits


def _far_from_others(
    values: Sequence[float], middle: float, times: float
) -> tuple[list[int], float]:
    """Places of values far from all the others, fewer than an event's; the others' radius."""
    steps = [abs(later - sooner) for sooner, later in pairwise([0.0, *values]) if later != sooner]
    quantum = min(steps, default=0.0)
    far = [abs(value - middle) for value in values]
    order = sorted(range(len(values)), key=lambda k: far[k] * abs(values[k]), reverse=True)
    for count in range(min(EVENT, len(values)) - 1, 0, -1):
        others, least = order[count:], order[count - 1]
        radius, level = max(far[k] for k in others), max(abs(values[k]) for k in others)
        bound = times**2 * max(radius, quantum) * max(level, quantum)
        if far[least] * abs(values[least]) > bound:
            return order[:count], radius
    return [], inf


def first_is_lone(signals: Tensor, moving: Tensor, times: float) -> bool:
    """Whether the first samples in motion of signals (T, C) hold an outlier, as a stream judges."""
    begun = (moving | (signals != 0.0).any(dim=-1)).nonzero()
    if not len(begun):
        return False
    first = int(begun[0])
    enough = (moving[first : first + FADE].cumsum(dim=0) >= YOUNG).nonzero()
    columns = signals[first : first + FADE].T.tolist()
    for end in range(int(enough[0]) + 1, len(columns[0]) + 1) if len(enough) else ():
        window = {("", i): values[:end] for i, values in enumerate(columns)}
        limits = limits_of_first(window, times)
        if limits is not None:
            return bool(limits)
    return False


def lone(signal: Tensor, moving: Tensor, times: float) -> bool:
    """Whether a whole signal (T, C) holds an outlier; moving (T,): samples that are not at rest.

    Without a model the size is judged, and ahead of time: both by what `Ranges` says.
    """
    size, step = signal.abs(), torch.diff(signal, dim=0, prepend=signal[:1]).abs()
    level_before, step_before = _of_late(size), _of_late(step)
    old = (moving.cumsum(dim=0) > YOUNG)[:, None]
    far = old & (step > step_before) & (step * size > times**2 * step_before * level_before)
    for k, i in torch.nonzero(far).tolist():
        after, steps = signal[k : k + WINDOW, i], step_before[k, i]
        drift = torch.arange(1, len(after) + 1, device=signal.device) * steps
        moved, large = (after - signal[k - 1, i]).abs(), after.abs() > BEYOND * level_before[k, i]
        unusual = (moved > BEYOND * drift) | large
        stays = ((moved > drift) | large)[: NEWEST + 2]
        quantum = float(step[:k, i][step[:k, i] > 0.0].min()) if step[:k, i].any() else 0.0
        alone = int(unusual.sum()) < EVENT and not bool(stays.all())
        if alone and float(step[k, i]) > times**2 * quantum:
            return True
    return False


def _of_late(size: Tensor) -> Tensor:
    """The largest before each sample (T, C), fading."""
    fading = torch.arange(len(size), device=size.device)[:, None] / FADE
    grown = torch.cummax(torch.log(size) + fading, dim=0).values
    return torch.cat([torch.zeros_like(size[:1]), torch.exp(grown - fading)[:-1]])
