"""A VWNN sample by sample, compiled: for sample periods well below a millisecond."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.sample import Sample
from models import vwnn_compiled
from models.online.guard import Guard
from models.online.laws.law import Adapted, Law, work_for
from models.online.stream import Stream
from models.vwnn import VWNN


class VWNNStream(Stream):
    """`Stream` of a VWNN, two compiled calls a sample. Arguments: those of `Stream`.

    Compiles when built, so that the first sample is not late. `states` are changed in place.
    """

    def __init__(
        self,
        estimator: VWNN,
        law: Law,
        states: Sequence[Adapted] | None = None,
        guard: Guard | None = None,
    ) -> None:
        super().__init__(estimator, law, states, guard)
        (state,) = self.states
        self._weights, self._memory = (
            u.detach().cpu().numpy().copy() for u in (state.weights, state.memory)
        )
        self.states = [Adapted(torch.from_numpy(self._weights), torch.from_numpy(self._memory))]
        self._settings, self._work = law.settings(), work_for(self._weights)
        self._factors = estimator.activation.places().numpy()
        self._unfiltered = estimator.unfiltered_excitation
        self._sigmoid_weights = estimator.activation.weights()
        self._decay = float(estimator.filters.decay)
        self._xi = self.memory.numpy().copy()
        P, n = self._weights.shape
        self._phi_now, self._error = np.zeros(P), np.zeros(n)
        self._sigmoids = np.ones(estimator.activation.channels + 1)
        nothing = Sample(f=torch.zeros(estimator.inputs, dtype=torch.float64))
        self._learn(nothing, self._estimate(nothing), sound=False)  # compiles
        self._rest()

    @property
    def weights(self) -> list[Tensor]:
        return [torch.from_numpy(self._weights.copy())]

    def snapshot(self) -> dict[str, Any]:
        arrays = [u.copy() for u in self._changing()]
        return super().snapshot() | {"arrays": arrays, "prediction": self._prediction, "f": self._f}

    def restore(self, snapshot: dict[str, Any]) -> None:
        super().restore(snapshot)
        for array, before in zip(self._changing(), snapshot["arrays"], strict=True):
            array[:] = before
        self._prediction, self._f = snapshot["prediction"], snapshot["f"]

    def _changing(self) -> tuple[np.ndarray, ...]:
        return self._weights, self._memory, self._xi, self._phi_now

    def _rest(self) -> None:
        self._xi[:] = 0.0

    def _estimate(self, sample: Sample) -> Tensor:
        self._prediction, self._f = np.empty(self._error.size), sample.excitation.numpy()
        vwnn_compiled.estimate(
            *(self._xi, self._f, self._unfiltered, self._sigmoid_weights, self._factors),
            *(self._weights, self._sigmoids, self._phi_now, self._prediction),
        )
        return torch.from_numpy(self._prediction)

    def _learn(self, sample: Sample, a: Tensor, sound: bool) -> None:
        vwnn_compiled.learn(
            *(self._xi, a.numpy(), self._f, self._decay, sound, self.law.number, self._settings),
            *(
                self._phi_now,
                self._prediction,
                self._weights,
                self._memory,
                self._error,
                self._work,
            ),
        )
