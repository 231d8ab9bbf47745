"""A VWNN sample by sample, compiled: for sample periods well below a millisecond."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
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
    """`Stream` of a VWNN, one compiled call a sample. Arguments: those of `Stream`.

    Compiles when built, so that the first sample is not late. `states` are changed in place. A
    sample that is not as it should be is gone through as in `Stream`, with two compiled calls, and
    so are those in which that still counts.
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
        self._shapes = nothing.f.shape, self.newest.shape
        times, own = self.watch.ranges.times, self.watch.guard
        self._own = (
            *(np.zeros(estimator.inputs), np.zeros(n), self._xi, self._unfiltered, self._decay),
            *(self._sigmoid_weights, self._factors, self._weights, self._sigmoids, self._phi_now),
            *(self._settings, self._memory, self._error, self._work),
            np.array([inf if times is None else times, own.full_scale, own.repeats]),
        )
        self._waits = True  # until it is known that nothing that came before counts still
        self._take_numbers()
        self._stepped(nothing.f.tolist(), [np.nan] * n)  # compiles, and is refused
        self._rest()

    def step(self, sample: Sample) -> Tensor:
        """As in `Stream`, in one compiled call where a sample is as it should be."""
        time = self.watch.next_time(sample.time)
        if time is None or not self._fits(sample):
            return super().step(sample)
        assert sample.a is not None
        if not self._stepped(sample.f.tolist(), sample.a.tolist()):
            return super().step(sample)
        self.watch.sample, self.watch.time, self.watch.sound = self.watch.sample + 1, time, sample
        self.previous, self.newest = sample, torch.from_numpy(self._prediction)
        estimate, restart = self.newest, self._restart
        if restart.rival is not None:
            restart.rival.step(sample)
        if self.watch.sample >= restart.due:
            restart.review(self)
        return estimate

    def _fits(self, sample: Sample) -> bool:
        """Whether a sample may be as it should be, as far as can be said before its values."""
        f, a = sample.f, sample.a
        if a is None or f.dtype != torch.float64 or a.dtype != torch.float64:
            return False
        if (f.shape, a.shape) != self._shapes:
            return False
        if sample.x is not None or sample.v is not None or sample.e is not None:
            return False
        if sample.s is not None or sample.s_dot is not None:
            return False
        if self._waits:
            self._came_twice = False
            self._waits = self.sample is not None or self._hold is not None or self.watch.waits
        return not self._waits

    def estimate(self, sample: Sample) -> Tensor:
        self._waits = True
        return super().estimate(sample)

    def _take_numbers(self) -> None:
        """The guard's numbers, which a compiled step reads and changes, beside those of its own."""
        ranges = self.watch.ranges
        inputs = ranges.numbers("f", self._shapes[0].numel())
        self._room = (*self._own, np.asarray(inputs), np.asarray(ranges.of["a"]))

    def _stepped(self, f: list[float], a: list[float]) -> bool:
        """Whether a sample was as it should be; its estimate is then the prediction."""
        self._prediction = np.empty(self._error.size)
        number = self.law.number
        return bool(vwnn_compiled.step(tuple(f), tuple(a), self._prediction, number, *self._room))

    @property
    def weights(self) -> list[Tensor]:
        return [torch.from_numpy(self._weights.copy())]

    def snapshot(self) -> dict[str, Any]:
        arrays = [u.copy() for u in self._changing()]
        return super().snapshot() | {"arrays": arrays, "prediction": self._prediction, "f": self._f}

    def restore(self, snapshot: dict[str, Any]) -> None:
        super().restore(snapshot)
        self._waits = True
        self._take_numbers()
        for array, before in zip(self._changing(), snapshot["arrays"], strict=True):
            array[:] = before
        self._prediction, self._f = snapshot["prediction"], snapshot["f"]

    def _changing(self) -> tuple[np.ndarray, ...]:
        return self._weights, self._memory, self._xi, self._phi_now

    def _rest(self) -> None:
        self._xi[:] = 0.0

    def _estimate(self, sample: Sample) -> Tensor:
        self._prediction = np.empty(self._error.size)
        self._f = sample.excitation.contiguous().numpy()
        vwnn_compiled.estimate(
            *(self._xi, self._f, self._unfiltered, self._sigmoid_weights, self._factors),
            *(self._weights, self._sigmoids, self._phi_now, self._prediction),
        )
        return torch.from_numpy(self._prediction)

    def _learn(self, sample: Sample, a: Tensor, sound: bool) -> None:
        vwnn_compiled.learn(
            *(self._xi, a.contiguous().numpy(), self._f, self._decay, sound),
            *(self.law.number, self._settings),
            *(self._phi_now, self._prediction, self._weights, self._memory),
            *(self._error, self._work),
        )
