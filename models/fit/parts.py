"""Parts of a record: where its motion begins, and what of it is held back to be judged on.

B records, T samples, n DOFs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from data.record import Record

LOCAL, QUIET = 0.02, 0.2  # of a record, over which its level is taken; of its level: at rest
SHORTEST = 20  # samples


def onset(record: Record) -> int:
    """The first sample of the motion after a quiet start, the earliest of a batch."""
    size = _squares(record)
    width = max(SHORTEST, round(LOCAL * record.samples))
    if record.samples <= width:
        return 0
    level = _levels(size, width)
    moving = (level > QUIET**2 * size.mean(dim=1, keepdim=True)).any(dim=0)
    first = int(moving.int().argmax())
    return first + width - 1 if first > 0 else 0


def held_back_from(record: Record, share: float) -> int:
    """The sample after which the last `share` of the motion lies, by its power and not by time."""
    size = _squares(record)
    done = (size / size.sum(dim=1, keepdim=True).clamp_min(1e-300)).mean(dim=0).cumsum(dim=0)
    first = int((done < 1.0 - share).sum())
    return min(max(first, SHORTEST, record.warmup + 1), record.samples - 2)


def grows(records: Sequence[Record], share: float) -> bool:
    """Whether the last `share` of the motion has more strength than all before.

    A law that was fitted to what came before is then asked for what nothing told it.
    """
    for record in records:
        width = min(SHORTEST, record.samples // 2)
        level = _levels(_squares(record), width)
        before = max(1, held_back_from(record, share) - width + 1)
        if float(level[:, before:].max()) > float(level[:, :before].max()):
            return True
    return False


def without_held_back(record: Record, share: float, first: bool) -> Record:
    """What is trained on, beside a `share` of the motion that is held back: its first, or last."""
    if first:  # it is simulated, and does not count
        start = held_back_from(record, 1.0 - share)
        return replace(record, warmup=max(record.warmup, start))
    return record.window(0, held_back_from(record, share), record.warmup)


def held_back(record: Record, share: float, first: bool) -> Record:
    """What is judged on: the first `share` of the motion, or the last after all before it."""
    if first:
        return record.window(0, held_back_from(record, 1.0 - share), record.warmup)
    return replace(record, warmup=held_back_from(record, share))


def _squares(record: Record) -> Tensor:
    """Σ ẍ² (B, T) over the channels."""
    return record.a.square().sum(dim=-1).reshape(-1, record.samples)


def _levels(squares: Tensor, width: int) -> Tensor:
    """Means of so many squares from each sample on (B, T − width + 1)."""
    sums = torch.nn.functional.pad(squares.cumsum(dim=1), (1, 0))
    return (sums[:, width:] - sums[:, :-width]) / width
