"""Records cut into windows of equal length, as a PyTorch Dataset.

A window of `length` samples begins with `warmup` samples that filters may use and metrics do not
count. By default a window is a whole record; windows follow each other so that every counted sample
is counted once (`stride = length − warmup`), and a rest at the end is not used.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.utils.data import Dataset

from data.checked import checked
from data.record import Record

MOVING = ("f", "v", "s_dot")  # what is nil at rest; an acceleration is, too


def cut(shortest: int, length: int | None, stride: int | None, warmup: int) -> tuple[int, int]:
    """Length and stride of the windows of records; `samples`: of the shortest.

    Raises ValueError for windows that do not fit.
    """
    length = shortest if length is None else length
    if not 2 <= length <= shortest:
        raise ValueError(
            f"data.window={length} samples must lie between 2 and the shortest record's "
            f"{shortest} samples"
        )
    if not 0 <= warmup < length:
        raise ValueError(
            f"data.warmup={warmup} must be shorter than the window of {length} samples"
        )
    stride = length - warmup if stride is None else stride
    if stride < 1:
        raise ValueError(f"data.stride={stride} samples must be at least 1")
    return length, stride


def after_rest(record: Record, samples: int) -> Record:
    """A record that begins at rest, (T, ·), with rest before it, up to a number of samples."""
    before = samples - record.samples

    def longer(name: str, u: Tensor) -> Tensor:
        nil = name in MOVING or (name == "a" and record.quantity in ("acceleration", "velocity"))
        rest = torch.zeros_like(u[:1]) if nil else u[:1]
        return torch.cat([rest.expand(before, -1), u])

    signals: dict[str, Any] = {name: longer(name, u) for name, u in record.signals().items()}
    return replace(record, **signals)


@checked
class WindowDataset(Dataset[Record]):
    """Windows of one or many records. Raises ValueError for windows that fit no record."""

    def __init__(
        self,
        records: Sequence[Record],
        length: int | None = None,  # samples; None takes whole records
        stride: int | None = None,  # samples; None takes length − warmup
        warmup: int = 0,  # samples
        whole: bool = False,  # each record in its own length
        to_the_end: bool = False,  # one more window where some samples are left at the end
    ) -> None:
        if not records:
            raise ValueError("no records to cut into windows")
        shortest = min(record.samples for record in records)
        length, stride = cut(shortest, length, stride, warmup)
        for record in records:
            record.require_finite()
        self.records, self.length, self.warmup = list(records), length, warmup
        self.places = [
            (i, start, record.samples if whole else length)
            for i, record in enumerate(records)
            for start in ([0] if whole else _starts(record.samples, length, stride, to_the_end))
        ]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, index: int) -> Record:
        i, start, length = self.places[index]
        record = self.records[i]
        return record.window(start, length, max(self.warmup, record.warmup - start))


def _starts(samples: int, length: int, stride: int, to_the_end: bool) -> list[int]:
    starts = list(range(0, samples - length + 1, stride))
    if to_the_end and starts[-1] + length < samples:
        starts.append(samples - length)
    return starts
