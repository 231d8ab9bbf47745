"""The free run of a record: an estimator's own motion under the record's excitation.

It begins as the record says: at rest, in a given state, or in a periodic steady state.
B records, T samples, n DOFs.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from data.record import Drive, Record, Response
from models.estimator import Estimator, NoFreeRunError

PERIODS = (2, 5)  # how often a periodic excitation is repeated, and again where that was too short
SETTLED = 1e-6  # largest change of the motion between two periods, relative


def simulate(estimator: Estimator, record: Record) -> Response:
    """Motion (…, T, n) under the record's excitation; no measured sample but the first is seen.

    Raises NoFreeRunError for an estimator that has none, and for a record that begins in motion
    without its state.
    """
    try:
        drive = record.drive()
    except ValueError as reason:
        raise NoFreeRunError(str(reason)) from None
    periodic = record.initial_state == "periodic"
    return periodic_run(estimator, drive) if periodic else estimator.run_of(record)


def periodic_run(estimator: Estimator, drive: Drive) -> Response:
    """The last period of an excitation that repeats itself: the steady state, where it is reached.

    `drive` is one period; runs begin at rest and always from the start, for estimators remember
    more than the state. Times of the response count from the start of its period.
    """
    T = drive.samples
    for periods in PERIODS:
        whole = estimator.free_run(replace(drive, u=torch.cat([drive.u] * periods, dim=-2)))
        if _settled(whole.a, T):
            break
    return Response(*(s[..., -T:, :] for s in (whole.x, whole.v, whole.a)))


def _settled(a: Tensor, T: int) -> bool:
    """The accelerations in the last quarter of the last two periods agree.

    Not the states: some estimators get theirs by integration, which drifts.
    """
    tail = -(-T // 4)
    before, last = a[..., -T - tail : -T, :], a[..., -tail:, :]
    change = torch.linalg.vector_norm(last - before)
    return bool(change <= SETTLED * torch.linalg.vector_norm(last))
