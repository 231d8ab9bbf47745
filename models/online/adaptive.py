"""On-line identification: one pass over the record, sample by sample, the weights adapting.

The original use of the VWNN: Kosmatopoulos, Smyth, Masri & Chassiakos (2001); Pei, Smyth &
Kosmatopoulos (2004). Any estimator that is linear in its weights can be adapted.
T samples, n DOFs, heads j.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import torch
from torch import Tensor

from data.record import Drive, Record, Response, singles
from data.sample import samples_of
from models.estimator import Estimator
from models.linear_in_weights import LinearInWeights, require_linear
from models.online.guard import Guard
from models.online.laws.frozen import Frozen
from models.online.laws.law import Adapted, Law
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream, started
from models.online.vwnn_stream import VWNNStream
from models.vwnn import VWNN


class Online(Estimator):
    """An estimator whose weights a law adapts, from zero at the first sample of training.

    estimator: linear in its weights; None: a VWNN with its defaults. law: None: recursive least
    squares. guard: against bad samples; None: a Guard with its defaults.

    Training is one pass over the training records, one after the other. `forward` goes on from
    there on every record again, adapting; the module stays as it is. Other ways of estimating:
    "frozen", with the weights as training left them, and "from_nothing", from zero weights on.
    Raises ValueError for an estimator whose weights do not all enter linearly.
    """

    mends = True  # see its guard

    def __init__(
        self,
        dofs: int,
        inputs: int,
        dt: float,
        estimator: Estimator | None = None,
        law: Law | None = None,
        guard: Guard | None = None,
    ) -> None:
        super().__init__(dofs, inputs, dt)
        inner = estimator or VWNN(dofs, inputs, dt)
        what = f"model.estimator is {type(inner).__name__}"
        self.estimator, self.guard = require_linear(inner, what, solved=True), guard or Guard()
        self.law = law or RecursiveLeastSquares()
        for j, state in enumerate(started(self.estimator, self.law)):
            self.register_buffer(f"memory_{j}", state.memory)

    def identify(self, batches: Iterable[Record]) -> dict[str, float]:
        report = self.estimator.prepare(batches)
        states = started(self.estimator, self.law, from_nothing=True)
        for record in singles(batches):
            _, states = self.follow(record, self.law, states)
        with torch.no_grad():
            for j, (head, state) in enumerate(zip(self.estimator.heads(), states, strict=True)):
                head.copy_(state.weights)
                getattr(self, f"memory_{j}").copy_(state.memory)
        return report

    def states(self) -> list[Adapted]:
        """The law's state at the end of training."""
        heads = self.estimator.heads()
        for head in heads:
            self.require_identified(head)
        return [Adapted(w.detach(), getattr(self, f"memory_{j}")) for j, w in enumerate(heads)]

    def forward(self, record: Record) -> Tensor:
        return self._of_batch(record, self.law, self.states())

    def estimates(self, record: Record) -> dict[str, Tensor]:
        nothing = started(self.estimator, self.law, from_nothing=True)
        return {
            "": self(record),
            "frozen": self._of_batch(record, Frozen(), self.states()),
            "from_nothing": self._of_batch(record, self.law, nothing),
        }

    def free_run(self, drive: Drive) -> Response:
        """The motion with the weights as training left them."""
        return self.estimator.free_run(drive)

    def stream(self, from_nothing: bool = False) -> Stream:
        """Estimates of single samples, adapting from the end of training or from zero weights."""
        states = self.states() if not from_nothing else started(self.estimator, self.law, True)
        return stream_of(self.estimator, self.law, states, self.guard)

    def check(self, signals: Record | Drive) -> None:
        self.estimator.check(signals)

    @torch.no_grad()
    def follow(
        self, record: Record, law: Law, states: list[Adapted]
    ) -> tuple[Tensor, list[Adapted]]:
        """Estimates (T, n) of one record and the states after it; the warm-up teaches nothing."""
        stretches = list(self.stretches(record, law, states))
        return torch.cat([estimates for estimates, _ in stretches]), stretches[-1][1]

    def stretches(
        self, record: Record, law: Law, states: list[Adapted], longest: int = 1 << 30
    ) -> Iterator[tuple[Tensor, list[Adapted]]]:
        """Estimates of a record and the states after them, stretch by stretch.

        longest: samples that a stretch has at most; one ends at each multiple of it.
        """
        self.check(record)
        if self.guard.finds(record):
            yield from self._sample_by_sample(record, law, states, longest)
            return
        mixing, known = self.estimator.mixing(), self.estimator.known(record)
        target = record.a if known is None else record.a - known
        if mixing is not None:
            target = target @ torch.linalg.inv(mixing)
        sizes = [state.weights.shape[1] for state in states]
        for span, phi in self.estimator.features_of(record):
            ends = range(span.start - span.start % longest + longest, span.stop, longest)
            for start, stop in pairwise([span.start, *ends, span.stop]):
                here = slice(start, stop)
                within = slice(here.start - span.start, here.stop - span.start)
                first, parts = max(record.warmup - start, 0), target[here].split(sizes, dim=-1)
                heads = zip(states, phi, parts, strict=True)
                followed = [law.follow(s, u[within], y, first) for s, u, y in heads]
                states = [state for _, state in followed]
                outputs = torch.cat([estimates for estimates, _ in followed], dim=-1)
                outputs = outputs if mixing is None else outputs @ mixing
                yield outputs if known is None else outputs + known[here], states

    def _sample_by_sample(
        self, record: Record, law: Law, states: list[Adapted], longest: int
    ) -> Iterator[tuple[Tensor, list[Adapted]]]:
        """`stretches` of a record with bad samples, in which the guard uses estimates."""
        stream, estimates = Stream(self.estimator, law, states, self.guard), []
        for k, sample in enumerate(samples_of(record)):
            stream.law = Frozen() if k < record.warmup else law
            estimates.append(stream.step(sample))
            if len(estimates) == longest or k == record.samples - 1:
                yield torch.stack(estimates), stream.states
                estimates = []

    def _of_batch(self, record: Record, law: Law, states: list[Adapted]) -> Tensor:
        """Estimates (…, T, n) of every record of a batch, each from the same states."""
        estimates = [self.follow(one, law, states)[0] for one in singles([record])]
        return torch.stack(estimates).reshape(record.a.shape)


def stream_of(estimator: LinearInWeights, law: Law, states: list[Adapted], guard: Guard) -> Stream:
    """A stream of an estimator, compiled for a VWNN."""
    if type(estimator) is VWNN:
        return VWNNStream(estimator, law, states, guard)
    return Stream(estimator, law, states, guard)
