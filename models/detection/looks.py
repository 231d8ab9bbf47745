"""What a detector looks at: residuals of an estimator, or weights of an adapting one.

A look is a stretch of `every` samples; what is left over at the end of a record is not looked at.
K looks, n DOFs, P weights of each.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.record import Record
from models.estimator import Estimator
from models.online.adaptive import Online


@torch.no_grad()
def residual_looks(estimator: Estimator, records: Sequence[Record], every: int) -> Tensor:
    """Residuals a − â (B, K, every, n) [m/s²] of records of equal length."""
    errors = torch.stack([record.a - estimator(record) for record in records])
    count = _count(errors.shape[1], every)
    return errors[:, : count * every].unflatten(1, (count, every))


@torch.no_grad()
def weight_looks(online: Online, records: Sequence[Record], every: int) -> Tensor:
    """Weights (B, K, P, n) after every look, each record from the end of training on.

    Raises ValueError where an estimator has several heads, whose weights are of no one DOF.
    """
    if len(online.states()) != 1:
        raise ValueError(
            f"{type(online.estimator).__name__} has {len(online.states())} heads; watch its "
            "residuals, or choose an estimator with one weight matrix, such as online_linear"
        )
    looks = []
    for record in records:
        count = _count(record.samples, every)
        stretches = online.stretches(record, online.law, online.states(), every)
        weights = [states[0].weights for _, states in stretches]
        looks.append(torch.stack(weights[:count]))
    return torch.stack(looks)


def _count(samples: int, every: int) -> int:
    if not 1 <= every <= samples:
        raise ValueError(f"a look of {every} samples does not fit a record of {samples} samples")
    return samples // every
