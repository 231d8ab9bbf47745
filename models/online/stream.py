"""An estimator that is linear in its weights, sample by sample, while a law adapts them.

    stream = Stream(estimator, RecursiveLeastSquares())
    for sample in samples:
        estimate = stream.step(sample)

The estimate at k is made before a[k] is used. n DOFs; heads j with P_j features, n_j outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Any

import numpy as np
import torch
from torch import Tensor

from data.checked import checked
from data.sample import Sample
from models.linear_in_weights import LinearInWeights
from models.online.guard import Event, Guard, Watch
from models.online.guard_compiled import FADE
from models.online.laws.law import Adapted, Law

CHANGING = ["states", "memory", "sample", "previous", "newest"]
CHANGING += ["_came_twice", "_phi", "_outputs", "_known"]


@checked
class Stream:
    """Weights, filter states and the state of the guard, carried from sample to sample.

    states: of the law, one for each head; None: from the estimator's weights, or from zero where it
    has none yet. The estimator itself is not changed.
    """

    def __init__(
        self,
        estimator: LinearInWeights,
        law: Law,
        states: Sequence[Adapted] | None = None,
        guard: Guard | None = None,
    ) -> None:
        own = started(estimator, law) if states is None else list(states)
        self._begin(estimator, law, own, guard)
        self.memory = estimator.at_rest()
        self.mixing = estimator.mixing()
        self.unmixing = None if self.mixing is None else torch.linalg.inv(self.mixing)

    def _begin(self, estimator: Any, law: Law, states: list[Adapted], guard: Guard | None) -> None:
        """Set what every stream carries, before its first sample."""
        self.estimator, self.law, self.states = estimator, law, states
        self.watch = Watch(guard or Guard(), estimator.dofs, estimator.dt)
        self.memory = torch.zeros(0, dtype=torch.float64)
        self.sample: Sample | None = None  # estimated, its acceleration not yet known
        self.previous: Sample | None = None
        self.newest = torch.zeros(estimator.dofs, dtype=torch.float64)  # estimate
        self._came_twice = False
        self._phi: list[Tensor] = []
        self._outputs = self.newest
        self._known: Tensor | None = None
        self._hold: Hold | None = None
        self._restart = Restart(self.states)
        self._reads = [name for name in estimator.reads if name not in ("a", "f")]

    @property
    def weights(self) -> list[Tensor]:
        """W_j (P_j, n_j) of each head, as they are now."""
        return [state.weights for state in self.states]

    @property
    def numbers(self) -> dict[str, float]:
        """What else is estimated, by name, besides the acceleration."""
        return {}

    @property
    def noise(self) -> np.ndarray | None:
        """Of the sensors (n,) [m/s²], as in training; None of a model that does not know it."""
        return None

    @property
    def drifts(self) -> np.ndarray | None:
        """Of every storey now and at most, each with the half of its 95 % interval (4, E) [m].

        None of a model without storeys.
        """
        return None

    @property
    def events(self) -> list[Event]:
        """The bad samples so far, the newest thousand of them."""
        return list(self.watch.events)

    def step(self, sample: Sample) -> Tensor:
        """The estimate (n,) [m/s²] of a sample, made before its acceleration is learnt from."""
        estimate = self.estimate(sample)
        self.update(sample.a)
        return estimate

    def estimate(self, sample: Sample) -> Tensor:
        """The estimated acceleration (n,) [m/s²] of a sample; the measured one is not read.

        Where the sample before was never followed by `update`, its acceleration counts as dropped.
        """
        self._check(sample)
        if self.sample is not None:
            self.update(None)
        stray = self.watch.strays(sample)
        self._keep_call(self.estimate, sample, stray)
        missed = self.watch.arrive(sample.time)
        self._came_twice = missed < 0
        if missed < 0:
            return self.newest
        if missed > 0:
            self._bridge(missed)
        self.sample = self.watch.mended(sample, stray)
        self.newest = self._estimate(self.sample)
        return self.newest

    def update(self, a: Tensor | None) -> None:
        """Learn from the acceleration (n,) of the sample that was estimated last; None: dropped."""
        if self._came_twice:
            return
        if self.sample is None:
            raise ValueError("no sample is waiting for its acceleration; call estimate first")
        stray = a is not None and self.watch.strays_after(a, self.newest)
        self._keep_call(self.update, a, stray)
        known, sound = self.watch.judge(a, self.sample, self.newest, stray)
        self._learn(self.sample, known, sound)
        self.previous, self.sample = self.sample, None
        if self._hold is not None and not self.watch.repeats:
            self._hold = self._hold.decided(self)
        if self.watch.sample >= self._restart.due and not self.watch.repeats:
            self._restart.review(self)

    def _keep_call(self, call: Callable[[Any], Any], argument: Any, stray: bool) -> None:
        """Keep a call, and the stream as it is before, where a value is far off or lately was."""
        if self.watch.repeats:
            return
        if stray and self._hold is None:
            self._hold = Hold(self)
        if self._hold is not None:
            self._hold.calls.append((self.law, call, argument))
        if self._restart.rival is not None:
            getattr(self._restart.rival, call.__name__)(argument)

    @property
    def holds(self) -> bool:
        """Whether samples are held until it is known whether one was an outlier."""
        return self._hold is not None

    def begin_anew(self) -> Stream:
        """A stream of the same model in its first state, which never restarts."""
        anew = type(self)(self.estimator, self.law, self._restart.states, self.watch.guard)
        anew._restart.due = inf
        return anew

    def squares(self) -> tuple[float, float]:
        """Σ (a − â)² and Σ a² of sound samples in motion since they were asked for last."""
        return self.watch.squares()

    def take_over(self, rival: Stream) -> None:
        """Go on in the state of a stream that had the same samples, and name the restart."""
        snapshot = rival.snapshot()
        snapshot["watch"].keep_history(self.watch)
        self.restore(snapshot)
        self.watch.restart()

    def snapshot(self) -> dict[str, Any]:
        """All that a sample changes, as it is now."""
        return {name: getattr(self, name) for name in CHANGING} | {"watch": self.watch.snapshot()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Go back to a snapshot, which must not be used again."""
        self.watch.restore(snapshot["watch"])
        for name in CHANGING:
            setattr(self, name, snapshot[name])

    def _bridge(self, missed: int) -> None:
        """Go on over missing samples: inputs are held, estimates stand in for accelerations."""
        assert self.previous is not None
        if missed > self.watch.guard.longest:
            self._rest()
            return
        for _ in range(missed):
            estimate = self._estimate(self.previous)
            self._learn(self.previous, self.watch.bounded(estimate), False)

    def _rest(self) -> None:
        self.memory = self.estimator.at_rest()

    def _estimate(self, sample: Sample) -> Tensor:
        self._phi = self.estimator.features_at(sample, self.memory)
        pairs = zip(self._phi, self.states, strict=True)
        parts = [phi @ state.weights for phi, state in pairs]
        self._outputs = parts[0] if len(parts) == 1 else torch.cat(parts)
        estimate = self._outputs if self.mixing is None else self._outputs @ self.mixing
        self._known = self.estimator.known(sample)
        return estimate if self._known is None else estimate + self._known

    def _learn(self, sample: Sample, a: Tensor, sound: bool) -> None:
        if sound:
            errors = a - self.newest
            if self.unmixing is not None:
                errors = errors @ self.unmixing
            parts = errors.split([state.weights.shape[1] for state in self.states])
            heads = zip(self.states, self._phi, parts, strict=True)
            self.states = [self.law.adapt(state, phi, error) for state, phi, error in heads]
        self.memory = self.estimator.remember(sample, a, self.memory)

    def _check(self, sample: Sample) -> None:
        """Raise ValueError where a sample does not fit the estimator."""
        estimator, a = self.estimator, sample.a
        missing = [name for name in self._reads if getattr(sample, name) is None]
        if missing:
            raise ValueError(
                f"{type(estimator).__name__} reads {', '.join(missing)}, which the sample lacks"
            )
        if sample.f.dtype != torch.float64 or (a is not None and a.dtype != torch.float64):
            raise ValueError(
                "a sample's signals must be float64; make them by "
                "torch.tensor(values, dtype=torch.float64)"
            )
        channels = sample.excitation.numel()
        measured = estimator.dofs if a is None else a.numel()
        if (channels, measured) != (estimator.inputs, estimator.dofs):
            raise ValueError(
                f"the sample has {channels} channels of excitation and {measured} accelerations; "
                f"{type(estimator).__name__} was built for {estimator.inputs} and {estimator.dofs}"
            )


def started(estimator: LinearInWeights, law: Law, from_nothing: bool = False) -> list[Adapted]:
    """A law's states before the first sample, from the estimator's weights or from zero.

    Weights that were never identified start at zero too.
    """
    states = []
    for head in estimator.heads():
        known = not from_nothing and bool(torch.isfinite(head).all())
        states.append(law.start(head if known else torch.zeros_like(head)))
    return states


# What is done with a far value until it is known whether it was alone.
#
# An outlier is replaced at once. The stream as it was before is kept for some samples: where what
# came then lasts, it was an event, such as the first wave of an earthquake; the stream goes back
# and through these samples again, learning from all of them. Only the estimates made meanwhile
# stay.
#
# The first samples in motion, which nothing can be compared with, are held the other way round:
# they are learnt from as they come, and gone through again without those that prove outliers.


class Hold:
    """A stream before an outlier or its first motion, and the calls since, with their law."""

    def __init__(self, stream: Stream) -> None:
        self.before = stream.snapshot()
        self.calls: list[tuple[Law, Callable[[Any], Any], Any]] = []
        stream.watch.ranges.watch()

    def decided(self, stream: Stream) -> Hold | None:
        """None where all is decided; what is then known is held to in going through it again."""
        ranges = stream.watch.ranges
        limits = ranges.of_first() if ranges.first else ranges.event()
        if ranges.first and len(self.calls) > 2 * FADE:
            limits = {}
        if limits is None:
            return self if ranges.left or ranges.first else None
        if ranges.first and not limits:
            ranges.first, ranges.window = False, {}
            return None
        stream.restore(self.before)
        ranges, law = stream.watch.ranges, stream.law
        ranges.limits = limits
        for stream.law, call, argument in self.calls:
            call(argument)
        ranges.limits, stream.law = None, law
        stream.watch.replays += 1
        return None


# A model that is worse than no estimate restarts from its first state if that is better.
#
# An error Σ (a − â)² > Σ a² over a stretch of samples has one of two causes: an earlier fault has
# ruined the weights, or the signal is noise. A rival stream decides: it starts from the first
# state, adapts for one stretch, is compared over the next, and replaces the model if its squared
# error is less than half. A model of noise therefore never restarts. After each rival that was
# not better the pause doubles, so that a stream of noise soon costs no more than any other.

STRETCH = 200  # samples; twice the weights of a VWNN of three DOFs
SELDOM = 64  # stretches between two rivals at the most
QUIET = 0.1  # of the strong motion: in a pause with less of it no model is blamed for an error
BETTER = 0.5  # part of the square of the error


class Restart:
    """When a stream is reviewed next, its first states, and its rival while there is one."""

    def __init__(self, states: Sequence[Adapted]) -> None:
        self.states = list(states)
        self.due: float = STRETCH  # number of the sample
        self.since = 0  # number of the sample of the last review
        self.rival: Stream | None = None
        self.learns = False  # the rival, in its first stretch
        self.pause = 1  # stretches until the next rival
        self.known = 0.0  # Σ a² a sample, the largest that was estimated well

    def review(self, stream: Stream) -> None:
        """Compare a stream with none and with its rival, over the samples since the last review."""
        rival, watch = self.rival, stream.watch
        if stream.holds or (rival is not None and rival.holds):
            return  # the next sample will do
        missed, measured = stream.squares()
        samples, self.due = watch.sample - self.since, watch.sample + STRETCH
        self.since = watch.sample
        if missed < BETTER * measured:
            self.known = max(self.known, measured / samples)
        if missed <= max(measured, QUIET**2 * self.known * samples):
            self.rival, self.pause = None, 1
        elif rival is None:
            self.rival, self.learns = stream.begin_anew(), True
        elif self.learns:
            self.learns = False
            rival.squares()
        else:
            self._decide(stream, rival, missed, measured)

    def _decide(self, stream: Stream, rival: Stream, missed: float, measured: float) -> None:
        """Let the rival take over if it is better; else wait twice as long for the next one."""
        own, moved = rival.squares()
        self.rival = None
        if not isfinite(own) or own * measured >= BETTER * missed * moved:
            self.pause = min(2 * self.pause, SELDOM)
            self.due = stream.watch.sample + STRETCH * self.pause
            return
        stream.take_over(rival)
        self.pause, self.known = 1, 0.0
