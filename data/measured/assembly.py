"""Channels in SI units, on one even clock → a Record: what drives, what answers, what is estimated.

T samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from data.measured.channels import beside, matrix, numbered
from data.measured.onset import DRIVES, release
from data.record import Record
from data.sample import OUTPUTS

USUAL = ("acceleration", "force", "displacement")  # what is estimated, the first that is there
REFERENCES = ("absolute", "relative")
SLOPE = 9  # samples of the cubic whose slope is the rate of a support


@dataclass(frozen=True)
class Meaning:
    """What channels mean, where their names do not say it."""

    quantity: str | None = None  # what is estimated; None: the first of USUAL
    accelerations: str = "absolute"  # or "relative", to a support that s_ddot1 measures
    initial_state: str | None = None
    hold: str = "linear"


def with_rates(
    channels: Mapping[str, np.ndarray], dt: float, done: list[str]
) -> dict[str, np.ndarray]:
    """The channels, and the velocities of supports whose displacements alone were measured."""
    from scipy.signal import savgol_filter  # slow to import

    whole = dict(channels)
    for number in numbered(channels, "s"):
        if f"s_dot{number}" not in channels:
            s = channels[f"s{number}"]
            size = min(SLOPE, len(s) - (len(s) + 1) % 2)
            if size > 3:
                whole[f"s_dot{number}"] = savgol_filter(s, size, 3, deriv=1, delta=dt)
                done.append(f"s_dot{number} from the slopes of s{number}, over {size} samples")
    return whole


def record_of_channels(
    name: str, dt: float, channels: Mapping[str, np.ndarray], meaning: Meaning, whole: bool
) -> Record:
    """The record of channels (T,) [SI]; `whole`: it is not the rest of one that was cut in motion.

    Beside the acceleration of a support, s_ddot1, accelerations become relative to it, and
    displacements and velocities are taken to be so.
    Where nothing drives it, it is a free vibration, from a first state that is unknown unless x
    and v are measured.
    Raises ValueError for channels that hold nothing to estimate, and for a motion that nothing
    drives and that does not ring down, unless its initial state was stated.
    """
    quantity = meaning.quantity or next((q for q in USUAL if numbered(channels, OUTPUTS[q])), None)
    output = None if quantity is None else matrix(channels, OUTPUTS[quantity])
    if quantity is None or output is None:
        raise ValueError(
            f"{name}: the channels {', '.join(channels)} hold nothing to estimate; "
            "expected accelerations a1, …, displacements x1, … or forces of an element r1"
        )
    f, ground = matrix(channels, "f"), matrix(channels, "s_ddot")
    if ground is not None and quantity != "force":  # an imposed motion says more than its rate
        f = _driven_by_base(name, f, ground, channels)
        if quantity == "acceleration" and meaning.accelerations == "absolute":
            output = output - ground
    # beside accelerations only: an estimate of x must not see x
    x, v = (matrix(channels, s) if quantity == "acceleration" else None for s in ("x", "v"))
    numbers = numbered(channels, OUTPUTS[quantity])
    x, v = (u if numbered(channels, s) == numbers else None for s, u in (("x", x), ("v", v)))
    known = x is not None and v is not None
    others = beside(channels, quantity) if quantity != "force" else []
    imposed = quantity == "force"  # what an element remembers of motions before was not measured
    free = quantity != "force" and not any(numbered(channels, d) for d in DRIVES)
    begins = "given" if known else "unknown" if imposed or free or not whole else "rest"
    record = Record(
        dt=dt,
        a=output,
        f=output.new_zeros(len(output), 0) if f is None else f,
        x=x,
        v=v,
        s=None if based(channels, quantity) else matrix(channels, "s"),
        s_dot=None if based(channels, quantity) else matrix(channels, "s_dot"),
        e=matrix(channels, "u"),
        initial_state=meaning.initial_state or begins,
        hold=meaning.hold,
        quantity=quantity,
        numbers=tuple(numbers),
        o=torch.from_numpy(np.stack([channels[c] for c in others], axis=1)) if others else None,
        others=tuple(others),
    )
    undriven = record.excitation.shape[-1] == (0 if record.e is None else record.e.shape[-1])
    known_so = meaning.initial_state is not None or not whole
    if undriven and not (free and (known_so or release(channels) is not None)):
        raise ValueError(
            f"{name}: the channels {', '.join(channels)} hold nothing that drives the "
            "motion, and it does not ring down from its beginning; expected forces f1, …, a "
            "support's acceleration s_ddot1, or s1 and s_dot1; of a free vibration say "
            "data.initial_state=unknown"
        )
    record.require_finite()
    stated = meaning.initial_state is not None or begins != "rest"
    if not stated and begins_in_motion(record, based(channels, quantity)):
        return replace(record, initial_state="unknown")
    return record


def based(channels: Mapping[str, object], quantity: str) -> bool:
    """Whether a support's acceleration drives the motion, which is relative to that support."""
    return bool(numbered(channels, "s_ddot")) and quantity != "force"


def _driven_by_base(
    name: str, f: Tensor | None, ground: Tensor, channels: Mapping[str, object]
) -> Tensor:
    """A support's acceleration drives the motion relative to it by −M ι s̈: f = −s̈ in m/s²."""
    if f is not None or ground.shape[-1] != 1:
        raise ValueError(
            f"{name}: the channels {', '.join(channels)} mix a support's acceleration "
            "with forces or a second one; base excitation takes s_ddot1 with "
            "accelerations a1, …, or displacements x1, … relative to the base"
        )
    return torch.neg(ground)


# Whether a record begins in motion, by its first part alone.   T samples, n DOFs.
#
# At rest no element bears anything: the absolute acceleration of a base-excited structure begins at
# nil and without a slope, a displacement without a slope, and an acceleration under a force that
# begins at nil does so too.

FIRST, FEWEST = 0.1, 50  # of a record, and samples, that the beginning is compared with
MOVES = 0.4  # times its RMS there: what begins with more is in motion
NOISE = 3.0  # times the noise of a sensor, which a beginning has to exceed too
NIL = 0.1  # times its RMS: a force that begins with less has not begun


def begins_in_motion(record: Record, based: bool) -> bool:
    """Whether a motion (T, n) of unknown x and v begins away from rest.

    based: a support drives it, and its accelerations are relative to that support. False where the
    first part of the record cannot tell.
    """
    count = min(record.samples, max(FEWEST, round(FIRST * record.samples)))
    a, f = record.a[:count], record.f[:count]
    if count < FEWEST:
        return False
    if record.quantity == "displacement":
        return _begins_with(torch.diff(a, dim=0))
    if record.quantity != "acceleration":
        return False
    if based:
        absolute = a - f[:, :1]
        return _begins_with(absolute) or _begins_with(torch.diff(absolute, dim=0))
    not_yet = f[0].abs() < NIL * f.square().mean(dim=0).sqrt()
    return f.shape[1] > 0 and bool(not_yet.all()) and _begins_with(a)


def _begins_with(signal: Tensor) -> bool:
    """Whether any channel (T, n) begins far from its mean and from nil, and by more than noise.

    From its mean, for a sensor's offset is no motion; from nil, for slow motion has a mean, too.
    """
    size = signal.std(dim=0, correction=0)
    far = torch.minimum(signal[0].abs(), (signal[0] - signal.mean(dim=0)).abs())
    noise = torch.diff(signal, n=3, dim=0).square().mean(dim=0).div(20.0).sqrt()
    return bool((far > torch.maximum(MOVES * size, NOISE * noise)).any())
