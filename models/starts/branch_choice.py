"""Which branch law an element gets: memory, sides, prior, judged on a motion held back.

A law of more memory, of sides that differ, or of a weaker prior, fits more of the motions that it
sees; whether it holds elsewhere shows on one that it has not seen. That is the largest where there
are several, so that the choice looks beyond the range that was fitted, and else the last part of
the only one. Laws are fitted by damped least squares; units are those of all motions, so that a fit
can go on with all.
T samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from data.record import Record
from models.composition.branch_law import is_larger, is_unsymmetric
from models.fit.doing import doing
from models.fit.objective import restore, state_of
from models.fit.parts import held_back_from
from models.fit.problem import FreeRunProblem
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt

Law = Any  # a BranchElement, whose file imports this one
Test = tuple[Tensor, Tensor, Tensor]  # deformations, rates and forces (T, E)
Make = Callable[[bool, bool, float], Law]  # by memory, sides and prior, of one element
WEIGHTS = (1e-5, 1e-6, 1e-7)  # of the prior, one after the other
WORTH = 0.95  # of the error of a smaller law: what one of more memory has to be below
SIDES = 0.7  # the same of one whose sides differ: those of a material that does are far below
HARM = 1.2  # times the least error: what a weaker prior may have, for it will see that motion too
HELD_BACK = 0.2  # of a single motion
SOLVER = {"damping": 1e-2, "decrease": 0.2, "increase": 4.0, "scaled": True, "floor": 3e-3}
ITERATIONS, CHANGE, PATIENCE, FIRST = 100, 5e-3, 8, 12  # of a fit; the first ones of every start
TRIED = 2e-2  # CHANGE of fits that are compared


@dataclass(frozen=True)
class Choice:
    """What is given: memory, prior and sides of a law, or None; starts: the best goes on."""

    force_memory: bool | None
    prior: float | None
    starts: int = 4
    seed: int = 0
    unsymmetric: bool | None = False

    @property
    def open(self) -> bool:
        return None in (self.force_memory, self.prior, self.unsymmetric)

    def settled(self, force_memory: bool, prior: float) -> Choice:
        """The choice with these in place of what is open."""
        return replace(
            self,
            force_memory=force_memory if self.force_memory is None else self.force_memory,
            prior=prior if self.prior is None else self.prior,
            unsymmetric=bool(self.unsymmetric),
        )

    @property
    def memories(self) -> Sequence[bool]:
        return (False, True) if self.force_memory is None else (self.force_memory,)

    @property
    def weights(self) -> Sequence[float]:
        return WEIGHTS if self.prior is None else (self.prior,)


@dataclass(frozen=True)
class Chosen:
    """A law fitted to all but what was held back, the weight of its prior, its error on that."""

    law: Law
    weight: float
    error: float


def require_starts(law_starts: int, seed: int) -> None:
    """Raise ValueError for numbers that make no sense."""
    if not isinstance(law_starts, int) or law_starts < 1:
        raise ValueError(f"model.law_starts={law_starts} must be a whole number, at least 1")
    if not isinstance(seed, int) or seed < 0:
        raise ValueError(f"model.seed={seed} must be a whole number, not negative")


def largest_motion(deformations: Sequence[Tensor]) -> int:
    """Number of the motion (T, E) whose elements go farthest, each beside its own largest way."""
    ways = torch.stack([y.abs().amax(dim=0) for y in deformations])
    return int((ways / ways.amax(dim=0).clamp_min(1e-300)).mean(dim=1).argmax())


def of_element(tests: Sequence[Test], e: int) -> list[Test]:
    """What the tests of all elements (T, E) hold of one of them (T, 1)."""
    one = slice(e, e + 1)
    return [(y[:, one], rate[:, one], r[:, one]) for y, rate, r in tests]


def chosen(make: Make, tests: Sequence[Test], largest: int, choice: Choice) -> Chosen:
    """The law of an element (T, 1) with the least error on what is held back.

    A law of more memory is taken where it gains by WORTH, then one whose sides differ by SIDES,
    with the strongest prior, by which all are compared; then the prior weakens while that helps.
    """

    def one(larger: bool, unsymmetric: bool) -> Chosen:
        law = make(larger, unsymmetric, choice.weights[0])
        rest, judged = parted(records_of(tests, law.dt), largest)
        law.measure(tests)
        law.sample([(r.s, r.s_dot, r.a) for r in rest if r.s is not None and r.s_dot is not None])
        _best_start(law, rest, choice)
        return _tried(law, choice.weights[0], rest, judged)

    best = _worth([one(larger, bool(choice.unsymmetric)) for larger in choice.memories], WORTH)
    if choice.unsymmetric is None:
        best = _worth([best, one(is_larger(best.law.sizes), True)], SIDES)
    rest, judged = parted(records_of(tests, best.law.dt), largest)
    least = best.error
    for weight in choice.weights[1:]:
        kept = state_of(best.law)
        found = _tried(best.law, weight, rest, judged)
        least = min(least, found.error)
        if not found.error <= HARM * least:
            restore(best.law, kept)
            break
        best = found
    return best


def _worth(found: Sequence[Chosen], share: float) -> Chosen:
    """The last law whose error is less than that share of what those before it have."""
    best, *larger = found
    for one in larger:
        best = one if one.error < share * best.error else best
    return best


def _tried(law: Law, weight: float, rest: Sequence[Record], judged: Record) -> Chosen:
    """The law, fitted further with a weight of its prior, and its error on what is held back."""
    law.weights.fill_(weight)
    doing(f"a law by motion held back, prior {weight:g}")
    minimised(law, Joint.of(law, rest), ITERATIONS, change=TRIED)
    error = float(FreeRunProblem(law, judged, None, prior=0.0).loss().detach()) ** 0.5
    return Chosen(law, weight, error if math.isfinite(error) else math.inf)


def fitted(
    make: Make, tests: Sequence[Test], choice: Choice, begin: Chosen | None = None
) -> tuple[Law, float]:
    """The law of an element fitted to all tests, and its relative error.

    From the law that was chosen; without one, of some starts the best after FIRST iterations.
    """
    if begin is None:
        law = begun(make, tests, choice)
    else:
        law = begin.law
        law.weights.fill_(begin.weight)
    records = records_of(tests, law.dt)
    doing("a law on all motions")
    minimised(law, Joint.of(law, records), ITERATIONS)
    plain = [FreeRunProblem(law, record, None, prior=0.0) for record in records]
    return law, float(Joint(plain).loss()) ** 0.5


def begun(make: Make, tests: Sequence[Test], choice: Choice) -> Law:
    """The law of an element at the best of its starts on all tests."""
    assert choice.force_memory is not None
    assert choice.prior is not None
    law = make(choice.force_memory, bool(choice.unsymmetric), choice.prior)
    law.measure(tests)
    law.sample(tests)
    _best_start(law, records_of(tests, law.dt), choice)
    return law


def records_of(tests: Sequence[Test], dt: float) -> list[Record]:
    return [
        Record(dt, r, r.new_zeros(len(r), 0), s=y, s_dot=rate, quantity="force")
        for y, rate, r in tests
    ]


def parted(records: Sequence[Record], largest: int) -> tuple[list[Record], Record]:
    """Records to fit, and the one to judge by; of a single record its first and its last part."""
    if len(records) > 1:
        return [r for i, r in enumerate(records) if i != largest], records[largest]
    (whole,) = records
    first = held_back_from(whole, HELD_BACK)
    return [whole.window(0, first, whole.warmup)], replace(whole, warmup=first)


def told(all_chosen: Sequence[Chosen]) -> dict[str, float | str]:
    """What was chosen for every element, in words."""
    memory = ["more" if is_larger(found.law.sizes) else "less" for found in all_chosen]
    sides = ["differ" if is_unsymmetric(found.law.sizes) else "alike" for found in all_chosen]
    return {
        "memory": ", ".join(memory),
        "sides": ", ".join(sides),
        "law_prior": ", ".join(f"{found.weight:g}" for found in all_chosen),
        "laws_off_held_back_percent": ", ".join(f"{100.0 * f.error:.2f}" for f in all_chosen),
    }


def _best_start(law: Law, records: Sequence[Record], choice: Choice) -> None:
    """Leave the law at the best of its starts after FIRST iterations on every other record."""
    some, ends = Joint.of(law, records[::2]), []
    generator = torch.Generator().manual_seed(choice.seed)
    for _ in range(choice.starts):
        law.restart(generator)
        minimised(law, some, FIRST)
        ends.append((float(some.loss()), state_of(law)))
    restore(law, min(ends, key=lambda end: end[0] if math.isfinite(end[0]) else math.inf)[1])


class Joint:
    """Problems of one model on records of unequal length, each weighted by its size.

    They are as `FreeRunProblem` is: y, loss() and normal_equations(every).
    """

    steepest = 1.0
    own: Sequence[Tensor] = ()

    def __init__(self, problems: Sequence[Any]) -> None:
        self.problems = problems
        sizes = np.array([float((p.y**2).sum()) for p in problems])
        self.shares = sizes / sizes.sum()
        self.y = torch.cat([p.y.reshape(-1) for p in problems])

    @classmethod
    def of(cls, model: Law, records: Sequence[Record]) -> Joint:
        return cls([FreeRunProblem(model, record, None) for record in records])

    @torch.no_grad()
    def loss(self) -> Tensor:
        losses = [w * p.loss() for w, p in zip(self.shares, self.problems, strict=True)]
        return torch.stack(losses).sum()

    def normal_equations(self, every: int = 1) -> tuple[Tensor, Tensor]:
        both = [p.normal_equations(every) for p in self.problems]
        weights = [
            w * self.y.numel() / p.y.numel()
            for w, p in zip(self.shares, self.problems, strict=True)
        ]
        matrix, vector = (
            torch.stack([w * part[i] for w, part in zip(weights, both, strict=True)]).sum(dim=0)
            for i in (0, 1)
        )
        return matrix, vector


def minimised(
    model: nn.Module,
    problem: Joint,
    iterations: int,
    every: int = 2,
    change: float = CHANGE,
    patience: int = PATIENCE,
) -> None:
    """Lower the loss by damped least squares; the model keeps the best that was reached."""
    free: Iterable[nn.Parameter] = [p for p in model.parameters() if p.requires_grad]
    solver = LevenbergMarquardt(
        free,
        iterations,
        change=change,
        patience=patience,
        every=every,
        **SOLVER,  # type: ignore[arg-type]
    )
    while not solver.finished:
        solver.solve(problem)
