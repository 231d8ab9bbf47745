"""Which of several fits goes on, where the motion of training hardly tells them apart.

Their training errors differ by a few percent, what they do farther out may differ a hundredfold: a
gap that training never closed, a yield point that it never passed. One of them may have gone astray
there; that most of them did in the same way is less likely.
B records, T samples, n DOFs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import torch
from torch import Tensor

from data.record import Record
from models.fit.objective import state_of
from models.fit.stands import MORE, scaled
from models.fit.trainable import Trainable

ALIKE = 1.5  # times the least loss


# where a fit ended: its loss, its state, and its run (…, T, n) of every batch under more excitation
End = tuple[float, list[Tensor], list[Tensor]]


@torch.no_grad()
def end_of(estimator: Trainable, loss: float, batches: Iterable[Record]) -> End:
    """The present state as an end."""
    runs = [estimator.free_run(scaled(record.measured(), MORE)).a for record in batches]
    return loss, state_of(estimator), runs


def middle(ends: Sequence[End]) -> list[Tensor]:
    """State of the end whose farther runs are nearest to the others', of those that fit alike.

    Of fewer than three the one with the least loss, and likewise where none of them agree.
    """
    least, best, _ = min(ends, key=lambda end: end[0])
    alike = [(state, farther) for loss, state, farther in ends if loss <= ALIKE * least]
    if len(alike) < 3:
        return best
    apart = [sum(_apart(one, other) for _, other in alike) for _, one in alike]
    return alike[apart.index(min(apart))][0] if math.isfinite(min(apart)) else best


def _apart(one: Sequence[Tensor], other: Sequence[Tensor]) -> float:
    """Distance of two ends' runs; infinite where one of them is lost and the other is not."""
    square = 0.0
    for run, same in zip(one, other, strict=True):
        there = torch.isfinite(run)
        if not torch.equal(there, torch.isfinite(same)):
            return math.inf
        square += float((run[there] - same[there]).square().sum())
    return math.sqrt(square)
