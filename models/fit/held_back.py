"""Motion that is held back to judge a fit by: a part of a record, or one motion of several.

Parts are counted by power and not by time: a quiet tail tells little. Where a motion begins is
counted so, too.   B records, T samples, n DOFs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import torch
from torch import Tensor

from data.record import SHORTEST, Record

Motion = TypeVar("Motion")
End = TypeVar("End")

HELD_BACK = 0.2  # of a motion, its last part: the usual share
LOCAL, QUIET = 0.02, 0.2  # of a record, over which its level is taken; of its level: at rest


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


def end_of_share(squares: Tensor, share: float) -> int:
    """The sample at which signals with `squares` (B, T) have had a share of their power."""
    shares = squares / squares.sum(dim=1, keepdim=True).clamp_min(1e-300)
    return int((shares.mean(dim=0).cumsum(dim=0) < share).sum())


def held_back_from(record: Record, share: float) -> int:
    """The sample after which the last `share` of the motion lies, by its power and not by time."""
    first = end_of_share(_squares(record), 1.0 - share)
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


def hold_back_one(
    motions: Sequence[Motion], judged: int, cut: Callable[[Motion], tuple[Motion, Motion]]
) -> tuple[list[Motion], Motion]:
    """Motions to fit, and the one of number `judged`; a single motion is cut in two instead."""
    if len(motions) > 1:
        return [m for i, m in enumerate(motions) if i != judged], motions[judged]
    first, last = cut(motions[0])
    return [first], last


def hold_back_record(records: Sequence[Record], judged: int) -> tuple[list[Record], Record]:
    """Records to fit, and the one to judge by; of a single record its first and its last part."""

    def cut(whole: Record) -> tuple[Record, Record]:
        return without_held_back(whole, HELD_BACK, False), held_back(whole, HELD_BACK, False)

    return hold_back_one(records, judged, cut)


def unless_worse(end: End, start: End, error: Callable[[End], float]) -> End:
    """Where a stage of a fit ended; where it began, if that errs by less on held-back motion."""
    return end if error(end) <= error(start) else start


def _squares(record: Record) -> Tensor:
    """Σ ẍ² (B, T) over the channels."""
    return record.a.square().sum(dim=-1).reshape(-1, record.samples)


def _levels(squares: Tensor, width: int) -> Tensor:
    """Means of so many squares from each sample on (B, T − width + 1)."""
    sums = torch.nn.functional.pad(squares.cumsum(dim=1), (1, 0))
    return (sums[:, width:] - sums[:, :-width]) / width
