"""Blocks of samples for a detector: residuals of an estimator, or weights of an adapting one.

A block holds `every` samples; samples that fill no block at the end of a record are left out.
K blocks, n DOFs, P weights of each DOF.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from data.record import Record
from models.estimator import Estimator
from models.online.adaptive import Online


@torch.no_grad()
def residual_blocks(estimator: Estimator, records: Sequence[Record], every: int) -> Tensor:
    """Residuals a − â (B, K, every, n) [m/s²] of records of equal length."""
    errors = torch.stack([record.a - estimator(record) for record in records])
    count = _count(errors.shape[1], every)
    return errors[:, : count * every].unflatten(1, (count, every))


@torch.no_grad()
def weight_blocks(online: Online, records: Sequence[Record], every: int) -> Tensor:
    """Weights (B, K, P, n) after every block; every record begins with those of training.

    Raises ValueError where an estimator has several heads, whose weights are of no one DOF.
    """
    if len(online.states()) != 1:
        raise ValueError(
            f"{type(online.estimator).__name__} has {len(online.states())} heads; watch its "
            "residuals, or choose an estimator with one weight matrix, such as online_linear"
        )
    weights_of_records = []
    for record in records:
        count = _count(record.samples, every)
        stretches = online.stretches(record, online.law, online.states(), every)
        weights = [states[0].weights for _, states in stretches]
        weights_of_records.append(torch.stack(weights[:count]))
    return torch.stack(weights_of_records)


def _count(samples: int, every: int) -> int:
    if not 1 <= every <= samples:
        raise ValueError(f"a block of {every} samples does not fit a record of {samples} samples")
    return samples // every
