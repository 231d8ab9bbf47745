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
from models.online.guard import Guard, Watch
from models.online.guard_compiled import BEFORE, LARGEST, MEASURED, MISSED, ROWS, SAME
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
        self._ordinary = Ordinary(self.watch, estimator.inputs)
        self._shapes = nothing.f.shape, self.newest.shape
        numbers = self._ordinary.numbers
        self._room = (
            *(np.zeros(estimator.inputs), np.zeros(n), self._xi, self._unfiltered, self._decay),
            *(self._sigmoid_weights, self._factors, self._weights, self._sigmoids, self._phi_now),
            *(self._settings, self._memory, self._error, self._work),
            *(self._ordinary.limits, numbers["f"], numbers["a"]),
        )
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
        return self._ordinary.taken or self._begin_ordinary()

    def _begin_ordinary(self) -> bool:
        """Whether nothing is being waited for; the guard's numbers are then in arrays."""
        if self.sample is not None or self._hold is not None:
            return False
        self._came_twice = False
        return self._ordinary.take(self.watch)

    def _stepped(self, f: list[float], a: list[float]) -> bool:
        """Whether a sample was as it should be; its estimate is then the prediction."""
        self._prediction = np.empty(self._error.size)
        number = self.law.number
        return bool(vwnn_compiled.step(tuple(f), tuple(a), self._prediction, number, *self._room))

    def estimate(self, sample: Sample) -> Tensor:
        self._end_ordinary()
        return super().estimate(sample)

    def update(self, a: Tensor | None) -> None:
        self._end_ordinary()
        super().update(a)

    def _end_ordinary(self) -> None:
        if self._ordinary.taken:
            self._ordinary.hand_back(self.watch)

    @property
    def weights(self) -> list[Tensor]:
        return [torch.from_numpy(self._weights.copy())]

    def squares(self) -> tuple[float, float]:
        self._end_ordinary()
        return super().squares()

    def snapshot(self) -> dict[str, Any]:
        self._end_ordinary()
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


# A guard's state as arrays, for as long as samples are as they should be.

RANGE = ("last", "level", "step", "quantum", "error")  # the first rows, of `Range`


class Ordinary:
    """The numbers of a `Watch` that the compiled step reads and changes, one column a channel.

    They are the watch's own from `take` to `hand_back`; in between it counts samples alone.
    """

    def __init__(self, watch: Watch, inputs: int) -> None:
        guard, dofs = watch.guard, len(watch.before)
        times = inf if guard.outlier is None else guard.outlier
        self.limits = np.array([times, guard.full_scale, guard.repeats])
        self.numbers = {"f": np.zeros((len(ROWS), inputs)), "a": np.zeros((len(ROWS), dofs))}
        self.taken = False

    def take(self, watch: Watch) -> bool:
        """Whether the next sample may be an ordinary one; the numbers are then taken over."""
        ranges = watch.ranges
        waiting = ranges.young, ranges.first, ranges.left, watch.blind, watch.unsettled
        if any(waiting) or watch.bad or watch.repeats or ranges.of.keys() != self.numbers.keys():
            return False
        for name, numbers in self.numbers.items():
            for j, one in enumerate(ranges.of[name]):
                numbers[: len(RANGE), j] = [getattr(one, row) for row in RANGE]
        own = self.numbers["a"]
        own[BEFORE], own[SAME], own[LARGEST] = watch.before, watch.same, watch.largest
        own[MISSED], own[MEASURED] = watch.missed, watch.measured
        watch.still_bad = set()
        self.taken = True
        return True

    def hand_back(self, watch: Watch) -> None:
        """Give the watch its numbers."""
        for name, numbers in self.numbers.items():
            for one, values in zip(watch.ranges.of[name], numbers.T.tolist(), strict=True):
                for row, value in zip(RANGE, values[: len(RANGE)], strict=True):
                    setattr(one, row, value)
        own = self.numbers["a"].tolist()
        watch.before, watch.same = own[BEFORE], list(map(int, own[SAME]))
        watch.largest, watch.missed, watch.measured = (own[k] for k in (LARGEST, MISSED, MEASURED))
        self.taken = False
