"""Parts of a record: where its motion begins, and what of it is held back to be judged on.

B records, T samples, n DOFs.
"""

from __future__ import annotations

import torch

from data.record import Record

LOCAL, QUIET = 0.02, 0.2  # of a record, over which its level is taken; of its level: at rest
SHORTEST = 20  # samples


def onset(record: Record) -> int:
    """The first sample of the motion after a quiet start, the earliest of a batch."""
    size = record.a.square().sum(dim=-1).reshape(-1, record.samples)  # (B, T)
    width = max(SHORTEST, round(LOCAL * record.samples))
    sums = torch.nn.functional.pad(size.cumsum(dim=1), (1, 0))
    if record.samples <= width:
        return 0
    level = (sums[:, width:] - sums[:, :-width]) / width  # from each sample on
    moving = (level > QUIET**2 * size.mean(dim=1, keepdim=True)).any(dim=0)
    first = int(moving.int().argmax())
    return first + width - 1 if first > 0 else 0


def held_back_from(record: Record, share: float) -> int:
    """The sample after which the last `share` of the motion lies, by its power and not by time."""
    size = record.a.square().sum(dim=-1).reshape(-1, record.samples)
    done = (size / size.sum(dim=1, keepdim=True).clamp_min(1e-300)).mean(dim=0).cumsum(dim=0)
    first = int((done < 1.0 - share).sum())
    return min(max(first, SHORTEST, record.warmup + 1), record.samples - 2)
