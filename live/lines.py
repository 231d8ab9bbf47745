"""A record as lines of text, such as sensors give them."""

from __future__ import annotations

from collections.abc import Iterator

from torch import Tensor

from data.record import Record
from data.sample import INPUTS, Sample
from data.stream.sources import paced


def lines_of(record: Record, base: bool, speed: float) -> Iterator[str]:
    """A header, then a line for each sample, every number to its last digit.

    base: the support's acceleration is the excitation; a line then holds this acceleration and the
    absolute ones, as sensors give them, and no integrated signals.
    """
    first = True
    for k, (_, sample) in enumerate(paced(record, speed)):
        signals = _signals(sample, base)
        if first:
            sizes = [(name, u.numel()) for name, u in signals.items()]
            heads = [f"{name}{i}" for name, size in sizes for i in range(1, size + 1)]
            yield ",".join(["t", *heads])
            first = False
        values = [value for u in signals.values() for value in u.tolist()]
        yield ",".join(map(repr, [round(k * record.dt, 9), *values]))


def _signals(sample: Sample, base: bool) -> dict[str, Tensor]:
    assert sample.a is not None
    if base:
        return {"s_ddot": -sample.f, "a": sample.a - sample.f}
    named = {name: getattr(sample, name) for name in (*INPUTS, "a")}
    return {name: u for name, u in named.items() if u is not None}
