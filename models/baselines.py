"""Estimates that know nothing of the structure: no motion, a rigid one, extrapolation.

A score below these identifies nothing. Before the record the structure is at rest.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn.functional import pad

from data.record import Drive, Record, Response
from models.estimator import Estimator, NoFreeRunError
from models.layers.filters import LowPassCascade


class NotApplicableError(ValueError):
    """Raised by a baseline that says nothing about records of this kind."""


class Motionless(Estimator):
    """ẍ̂ = 0, whatever the excitation. `forced` as in `data.datamodule.Data`."""

    reads: ClassVar[tuple[str, ...]] = ()
    on_base: ClassVar[bool]  # whether this is the word for it where a base moves

    def __init__(
        self, dofs: int, inputs: int, dt: float, forced: Sequence[int] | str | None = None
    ) -> None:
        super().__init__(dofs, inputs, dt)
        self.forced = forced

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        if (self.forced == "base") != self.on_base:
            raise NotApplicableError("motions relative to a base: rigid; all others: zero")
        return {}

    def forward(self, record: Record) -> Tensor:
        return torch.zeros_like(record.a)

    def free_run(self, drive: Drive) -> Response:
        still = drive.u.new_zeros(*drive.u.shape[:-1], self.dofs)
        return Response(still, still, still)


class Zero(Motionless):
    """The structure does not answer. Where a base moves it, that is `Rigid`."""

    on_base = False


class Rigid(Motionless):
    """The structure moves with its base as one piece: relative to it, not at all."""

    on_base = True


def _delayed(a: Tensor, samples: int) -> Tensor:
    return pad(a, (0, 0, samples, 0))[..., : a.shape[-2], :]


class Extrapolation(Estimator):
    """An estimate from past accelerations alone, which therefore has no free run."""

    reads = ("a",)

    def free_run(self, drive: Drive) -> Response:
        raise NoFreeRunError(
            "an extrapolation of measured accelerations has no excitation; "
            "from rest it would stay at zero for ever"
        )


class LastValue(Extrapolation):
    """ẍ̂[k] = ẍ[k−1]."""

    def forward(self, record: Record) -> Tensor:
        return _delayed(record.a, 1)


class TwoPoint(Extrapolation):
    """ẍ̂[k] = 2 ẍ[k−1] − ẍ[k−2], the straight line through the last two values."""

    def forward(self, record: Record) -> Tensor:
        return 2.0 * _delayed(record.a, 1) - _delayed(record.a, 2)


class FilteredExtrapolation(Extrapolation):
    """ẍ̂ = 2Hẍ − H²ẍ, which misses ẍ by (s/(s + ω_c))²: the share of the VWNN's filters alone."""

    def __init__(self, dofs: int, inputs: int, dt: float, cutoff: float = 50.0) -> None:
        super().__init__(dofs, inputs, dt)
        self.filters = LowPassCascade(cutoff, stages=2, dt=dt)

    def forward(self, record: Record) -> Tensor:
        once, twice = self.filters(record.a)[0].chunk(2, dim=-1)
        return 2.0 * once - twice
