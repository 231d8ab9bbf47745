"""x and v of a record as a composition is trained on them: measured, filtered, or reconstructed.

T samples, n outputs, m channels of excitation.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from data.record import Record
from models.composition.simulate import ACCELERATION, DISPLACEMENT, VELOCITY
from models.layers.reconstructed import reconstructed
from models.layers.state_variables import corner_frequency, state_variables

MEASURES = {"displacement": DISPLACEMENT, "velocity": VELOCITY, "acceleration": ACCELERATION}
BEYOND = 10.0  # times the corner of an acceleration's filter, for displacements and velocities


def states_of(
    record: Record, from_accelerations: bool
) -> Iterable[tuple[Tensor, Tensor, Tensor, Tensor]]:
    """x, v, a (T, n), u (T, m) as measured; filtered alike where x or v is missing.

    One after the other of a batch, without the warm-up. from_accelerations: measured x and v are
    not used.
    """
    counted = slice(record.warmup, None)
    a = record.a.reshape(record.a.shape[:-2].numel(), *record.a.shape[-2:])
    u = record.excitation.reshape(*a.shape[:2], record.excitation.shape[-1])
    measured = MEASURES[record.quantity]
    whole = measured == ACCELERATION and not from_accelerations
    for i in range(len(a)):
        if whole and record.x is not None and record.v is not None:
            x, v = record.x.reshape(a.shape)[i], record.v.reshape(a.shape)[i]
            yield x[counted], v[counted], a[i][counted], u[i][counted]
            continue
        corner = corner_frequency(a[i], record.dt)
        if measured != ACCELERATION:
            corner *= BEYOND  # the filters' own share is then flat below it
        size = corner ** (ACCELERATION - measured)
        x, v, filtered = (size * s for s in state_variables(a[i], corner, record.dt))
        yield x, v, filtered, size * state_variables(u[i], corner, record.dt)[measured]


def reconstructed_of(record: Record) -> tuple[Tensor, Tensor]:
    """x and v (…, T, n) from what was measured of a record's motion."""
    shape, order = record.a.shape, MEASURES[record.quantity]
    y, u = (s.reshape(-1, *s.shape[-2:]) for s in (record.a, record.excitation))
    found = [reconstructed(y[i], u[i], record.dt, order) for i in range(len(y))]
    x, v = (torch.stack(parts).reshape(shape) for parts in zip(*found, strict=True))
    return x, v
