"""How far the free run of a model, as it stands, is from the motions that it is to begin with."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from data.record import Record
from models.estimator import Estimator


@torch.no_grad()
def free_run_error(model: Estimator, records: Sequence[Record]) -> float | None:
    """Relative error, infinite where a run diverges; None where a record begins unknown."""
    error = size = 0.0
    for record in records:
        try:
            drive = record.drive()
        except ValueError:  # begins in motion, in a state that was not measured
            return None
        counted = slice(record.warmup, None)
        run = model.free_run(drive).a
        error += float((run - record.a)[..., counted, :].square().sum())
        size += float(record.a[..., counted, :].square().sum())
    return math.sqrt(error / size) if math.isfinite(error) and size > 0.0 else math.inf
