"""Whether a law stands another motion: no error on the one that it was fitted to says so."""

from __future__ import annotations

from dataclasses import replace

import torch

from data.record import Drive, Record
from models.fit.trainable import Trainable

MORE, BOUND = 1.5, 10.0  # times the excitation, and times the motion, that a model has to stand
LESS, LEFT = 0.1, 0.5  # times the excitation: less than this share of the motion has to be left


@torch.no_grad()
def stands(estimator: Trainable, record: Record) -> bool:
    """Whether free runs stay in bounds where the excitation is larger or smaller than a record's.

    Under MORE times the excitation a law that was bent to fit one motion may run away; under LESS
    of it one that makes energy at small motions goes on moving by itself. A force under an imposed
    motion is only tried under MORE: one of friction keeps its size under LESS.
    """
    more = estimator.free_run(scaled(record, MORE)).a.abs().max()
    if not float(more / record.a.abs().max()) < BOUND * MORE:  # NaN too
        return False
    if record.quantity == "force":
        return True
    whole, less = (estimator.free_run(scaled(record, share)).a for share in (1.0, LESS))
    left = float(less.square().mean() / whole.square().mean().clamp_min(1e-300)) ** 0.5
    return left < LEFT


def scaled(record: Record, share: float) -> Drive:
    """A larger or smaller motion under the same other inputs, such as a temperature."""
    scaled = record if record.e is None else replace(record, e=record.e / share)
    drive = scaled.drive()
    return replace(drive, u=share * drive.u, x0=share * drive.x0, v0=share * drive.v0)
