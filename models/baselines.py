"""Extrapolation of the measured acceleration: estimates that know nothing of the structure.

A one-step score below these identifies nothing. Before the record the structure is at rest.
"""

from __future__ import annotations

from torch import Tensor
from torch.nn.functional import pad

from data.record import Drive, Record, Response
from models.estimator import Estimator, NoFreeRunError
from models.layers.filters import LowPassCascade


def _delayed(a: Tensor, samples: int) -> Tensor:
    return pad(a, (0, 0, samples, 0))[..., : a.shape[-2], :]


class Extrapolation(Estimator):
    """An estimate from past accelerations alone, which therefore has no free run."""

    reads = ("a",)

    def free_run(self, drive: Drive) -> Response:
        raise NoFreeRunError(
            "an extrapolation of measured accelerations knows no excitation; "
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
