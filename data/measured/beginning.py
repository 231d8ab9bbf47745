"""Whether a record begins in motion, told by its first part alone.   T samples, n DOFs.

At rest no element bears anything: the absolute acceleration of a base-excited structure begins at
nil and without a slope, a displacement without a slope, and an acceleration under a force that
begins at nil does so too.
"""

from __future__ import annotations

import torch
from torch import Tensor

from data.record import Record

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
    """Whether any channel (T, n) begins far from its mean, and by more than noise."""
    signal = signal - signal.mean(dim=0)  # a sensor's offset is no motion
    size = signal.square().mean(dim=0).sqrt()
    noise = torch.diff(signal, n=3, dim=0).square().mean(dim=0).div(20.0).sqrt()
    return bool((signal[0].abs() > torch.maximum(MOVES * size, NOISE * noise)).any())
