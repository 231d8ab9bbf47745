"""Channels by name: a signal and a number, such as a1, the acceleration of DOF x1.

f force on a DOF; x, v, a displacement, velocity and acceleration of a DOF; s, s_dot, s_ddot those
of a support; drift of a storey, the displacement of its floor against the one below; strain, a
weighted sum of these (model.rows); r force of an element; u another input of an element, such as
the voltage of a damper or a temperature.
T samples.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

APART = ("f", "x", "v", "a", "drift", "strain")  # of DOFs, not all of which have a sensor
SIGNALS = (*APART, "s", "s_dot", "s_ddot", "r", "u")
CHANNEL = re.compile(rf"({'|'.join(SIGNALS)})([1-9][0-9]{{0,5}})")
CLOCKS = ("time", "t", "Time", "time_s", "TIME")  # columns that are taken for time


def signal_of(channel: str) -> str:
    """The signal of a channel without its number: a of a1, time of time."""
    return channel.rstrip("0123456789")


def numbered(channels: Iterable[str], signal: str) -> list[int]:
    """Numbers of the channels of a signal, ascending."""
    ends = [c.removeprefix(signal) for c in channels if signal_of(c) == signal]
    return sorted(int(end) for end in ends)


def has_gaps(numbers: Sequence[int]) -> bool:
    """Whether numbers are not 1, 2, … without one missing."""
    return list(numbers) != list(range(1, len(numbers) + 1))


def beside(channels: Iterable[str], quantity: str) -> list[str]:
    """Displacements, drifts and strains that were measured beside what is estimated.

    Displacements of the same floors as accelerations are among them where floors have no sensor:
    these have no x that a motion could begin at.
    """
    named = list(channels)
    a, x = numbered(named, "a"), numbered(named, "x")
    own = quantity != "acceleration" or (a == x and not has_gaps(a))
    numbers = {"x": [] if own else x} | {s: numbered(named, s) for s in ("drift", "strain")}
    return [f"{signal}{i}" for signal, some in numbers.items() for i in some]


def require_from_one(columns: Iterable[str]) -> None:
    """Raise ValueError for a column that is named as a channel would be, but for its number 0."""
    for name in columns:
        signal, number = signal_of(name), name.removeprefix(signal_of(name))
        if signal in SIGNALS and number and not number.strip("0"):
            raise ValueError(
                f"the column {name} is no channel: DOFs, floors and supports are numbered from 1, "
                f"such as {signal}1; rename it, or name the channels (data.channels)"
            )


def matrix(channels: Mapping[str, np.ndarray], signal: str) -> Tensor | None:
    """Channels of a signal (T, c), or None. Raises ValueError for a gap, unless among DOFs."""
    numbers = numbered(channels, signal)
    if not numbers:
        return None
    if signal not in APART and has_gaps(numbers):
        raise ValueError(
            f"there are the channels {', '.join(f'{signal}{i}' for i in numbers)}; expected "
            f"{signal}1 … {signal}{len(numbers)} without a gap"
        )
    columns = [channels[f"{signal}{i}"] for i in numbers]
    return torch.from_numpy(np.stack(columns, axis=1).astype(float, copy=False))
