"""Which branch law an element gets, and how far the free run may take it from there.

A law of more memory, of sides that differ, or of a weaker prior, fits more of the motions that it
sees; whether it holds elsewhere shows on one that it has not seen. That is the largest where there
are several, so that the choice looks beyond the range that was fitted, and else the last part of
the only one. Laws are fitted by damped least squares; units are those of all motions, so that a fit
can go on with all.

The free run sees what equilibrium does not, such as noise of accelerations and errors that add up;
where motions are sensitive it bends the laws to the motions that it sees. So the weight of the
prior around the laws by equilibrium is lowered step by step, on all motions but the largest, and
the weakest is taken whose free run is as near to that as any but for HARM: a law that goes beyond
what it was fitted to is so far off that small gains do not show there, and harm does. A polished
model also has to stand that motion 1.5 times as large, and a tenth of it; where none does, the laws
by equilibrium are no good, and the free run has its way. The first weight is next to no polish.

Where displacements alone were measured, forces by equilibrium have the noise of second derivatives,
laws are a tenth off, and free runs of them drift away. Runs then begin again at the reconstructed
motion first, ever more seldom, so that the free run may teach the laws what the noise has hidden.

What a law does where no motion of training led it is chance, and another start of it does something
else there: where laws run away under motions like those of training, they are fitted again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from data.record import Record, singles
from models.composition.branch_law import is_larger, is_unsymmetric
from models.composition.composite import Composite
from models.fit.extrapolation import farthest, free_run_error, stays_in_bounds
from models.fit.held_back import hold_back_record
from models.fit.minimise import minimise
from models.fit.objective import restore, state_of
from models.fit.problem import FreeRunProblem, Joint
from models.fit.progress import announce, is_out_of_time, leaves_out

Law = Any  # a BranchElement, whose file imports this one
Test = tuple[Tensor, Tensor, Tensor]  # deformations, rates and forces (T, E)
Make = Callable[[bool, bool, float], Law]  # by memory, sides and prior, of one element
WEIGHTS = (1e-5, 1e-6, 1e-7)  # of the prior, one after the other
WORTH = 0.95  # of the error of a smaller law: what one of more memory has to be below
SIDES = 0.7  # the same of one whose sides differ: those of a material that does are far below
HARM = 1.2  # times the least error: what a weaker prior may have, for it will see that motion too
SETTINGS = {
    **{"damping": 1e-2, "decrease": 0.2, "increase": 4.0, "scaled": True, "floor": 3e-3},
    **{"iterations": 100, "change": 5e-3, "patience": 8, "every": 2},
}
TRIED = 2e-2  # change of fits that are compared
POLISH = (1.0, 1e-3, 1e-6)
BY_DEFAULT = 1e-6  # where no free run can be judged, or none stands
RECONSTRUCTED = (1e-3, 1e-4, 1e-5)  # the weights, where displacements alone were measured
FIRST, STEPS, GROWING_STEPS = 12, 8, 15  # iterations: of every start, of runs, of every period
POLISHING = {**SETTINGS, "every": 4, "change": 2e-2, "patience": 3}
GROWING = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # periods from one beginning to the next
FAR, FITS = 4.0, 3  # times a motion, beyond which laws run away; fits until none does
Facts = dict[str, float | str]


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


def largest_motion(deformations: Sequence[Tensor]) -> int:
    """Number of the motion (T, E) whose elements go farthest, each beside its own largest way."""
    ways = torch.stack([y.abs().amax(dim=0) for y in deformations])
    return int((ways / ways.amax(dim=0).clamp_min(1e-300)).mean(dim=1).argmax())


def of_element(tests: Sequence[Test], e: int) -> list[Test]:
    """What the tests of all elements (T, E) hold of one of them (T, 1)."""
    one = slice(e, e + 1)
    return [(y[:, one], rate[:, one], r[:, one]) for y, rate, r in tests]


def choose_law(make: Make, tests: Sequence[Test], largest: int, choice: Choice) -> Chosen:
    """The law of an element (T, 1) with the least error on what is held back.

    A law of more memory is taken where it gains by WORTH, then one whose sides differ by SIDES,
    with the strongest prior, by which all are compared; then the prior weakens while that helps.
    """

    def one(larger: bool, unsymmetric: bool) -> Chosen:
        law = make(larger, unsymmetric, choice.weights[0])
        rest, judged = hold_back_record(records_of(tests, law.dt), largest)
        law.measure(tests)
        law.sample([(r.s, r.s_dot, r.a) for r in rest if r.s is not None and r.s_dot is not None])
        _best_start(law, rest, choice)
        return _fit_with_prior(law, choice.weights[0], rest, judged)

    best = _worth([one(larger, bool(choice.unsymmetric)) for larger in choice.memories], WORTH)
    if choice.unsymmetric is None:
        best = _worth([best, one(is_larger(best.law.sizes), True)], SIDES)
    rest, judged = hold_back_record(records_of(tests, best.law.dt), largest)
    least = best.error
    for weight in choice.weights[1:]:
        kept = state_of(best.law)
        found = _fit_with_prior(best.law, weight, rest, judged)
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


def _fit_with_prior(law: Law, weight: float, rest: Sequence[Record], judged: Record) -> Chosen:
    """The law, fitted further with a weight of its prior, and its error on what is held back."""
    law.weights.fill_(weight)
    announce(f"a law by motion held back, prior {weight:g}")
    minimise(Joint.of(law, rest), SETTINGS, change=TRIED)
    error = float(FreeRunProblem(law, judged, None, prior=0.0).loss().detach()) ** 0.5
    return Chosen(law, weight, error if math.isfinite(error) else math.inf)


def fit_law(
    make: Make, tests: Sequence[Test], choice: Choice, begin: Chosen | None = None
) -> tuple[Law, float]:
    """The law of an element fitted to all tests, and its relative error.

    From the law that was chosen; without one, from the best of some starts.
    """
    if begin is None:
        law = start_law(make, tests, choice)
    else:
        law = begin.law
        law.weights.fill_(begin.weight)
    records = records_of(tests, law.dt)
    announce("a law on all motions")
    minimise(Joint.of(law, records), SETTINGS)
    plain = [FreeRunProblem(law, record, None, prior=0.0) for record in records]
    return law, float(Joint(plain).loss()) ** 0.5


def start_law(make: Make, tests: Sequence[Test], choice: Choice) -> Law:
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


def facts_of(all_chosen: Sequence[Chosen]) -> dict[str, float | str]:
    """What was chosen for every element, in words."""
    memory = ["more" if is_larger(found.law.sizes) else "less" for found in all_chosen]
    sides = ["differ" if is_unsymmetric(found.law.sizes) else "alike" for found in all_chosen]
    return {
        "law_memory": ", ".join(memory),
        "tension_compression": ", ".join(sides),
        "law_prior": ", ".join(f"{found.weight:g}" for found in all_chosen),
        "held_out_force_error_percent": ", ".join(f"{100.0 * f.error:.2f}" for f in all_chosen),
    }


def _best_start(law: Law, records: Sequence[Record], choice: Choice) -> None:
    """Leave the law at the best of its starts after some iterations on every other record."""
    some, ends = Joint.of(law, records[::2]), []
    generator = torch.Generator().manual_seed(choice.seed)
    for number in range(choice.starts):
        if number and leaves_out("more starts of a law"):
            break
        law.restart(generator)
        minimise(some, SETTINGS, iterations=FIRST)
        ends.append((float(some.loss()), state_of(law)))
    restore(law, min(ends, key=lambda end: end[0] if math.isfinite(end[0]) else math.inf)[1])


def fit_until_bounded(
    model: Composite, records: Sequence[Record], fit: Callable[[int], Facts], seed: int
) -> Facts:
    """Fit from other seeds until the model stands motions like those of the records.

    Where no fit does, the one that goes least far is left. Returns what `fit` told of it, and how
    many ran away, if any did.
    """
    ends, generator = [], torch.Generator().manual_seed(seed)
    for _ in range(FITS):
        facts = fit(seed)
        ends.append((farthest(model, records), state_of(model), facts))
        if ends[-1][0] <= FAR or is_out_of_time():
            break
        seed = int(torch.randint(2**31, (1,), generator=generator))
    far, state, facts = min(ends, key=lambda end: end[0])
    restore(model, state)
    ran_away = len(ends) - (far <= FAR)
    return facts | ({"diverged_fits": f"{ran_away} of {len(ends)}"} if ran_away else {})


def polish_weight(model: Composite, records: Sequence[Record], largest: int) -> tuple[float, Facts]:
    """The weight of the prior, and what was found; the model is left as it was.

    largest: number of the motion that is judged by.
    """
    rest, judged = hold_back_record(list(singles(records)), largest)
    before, reconstructed = state_of(model), are_reconstructed(model, records)
    start = free_run_error(model, [judged])
    if start is None and not reconstructed:
        return BY_DEFAULT, {}
    if reconstructed:
        grow(model, rest, RECONSTRUCTED[0])
    ends = []
    for weight in RECONSTRUCTED if reconstructed else POLISH:
        announce(f"the free run of all laws, prior {weight:g}")
        problems = [FreeRunProblem(model, record, None, prior=weight) for record in rest]
        minimise(Joint(problems), POLISHING, iterations=STEPS)
        ends.append((*_judge(model, judged), weight))
    restore(model, before)
    falls, least, _ = min(ends)
    weight = min(w for fell, error, w in ends if fell == falls and error <= HARM * least)
    errors = [math.inf if start is None else start, *(error for _, error, _ in ends)]
    told = ", ".join(f"{100.0 * e:.2f}" for e in errors)
    weight = BY_DEFAULT if falls else weight
    return weight, {"prior": weight, "held_out_error_percent": told}


def are_reconstructed(model: Composite, records: Sequence[Record]) -> bool:
    """Whether x and v come from displacements or velocities, and runs can begin again at them."""
    measured = all(model.has_states(record) for record in records)
    return not measured and all(model.begins_anew(record) for record in records)


def grow(model: Composite, motions: Sequence[Record], weight: float) -> None:
    """Fit all laws to runs that begin again, at first every few samples, then ever more seldom."""
    announce("runs of all laws, longer and longer")
    period = min(1.0 / (dominant(motion.a, motion.dt) * motion.dt) for motion in motions)
    for horizon in dict.fromkeys(max(2, round(share * period)) for share in GROWING):
        problems = [FreeRunProblem(model, motion, horizon, prior=weight) for motion in motions]
        minimise(Joint(problems), POLISHING, iterations=GROWING_STEPS)


def _judge(model: Composite, record: Record) -> tuple[bool, float]:
    """Whether the model falls under larger or smaller motions, and the error of its free run."""
    error = free_run_error(model, [record])
    return not stays_in_bounds(model, record), math.inf if error is None else error


def dominant(a: Tensor, dt: float) -> float:
    """The frequency [Hz] below which half of the power of the velocities lies."""
    power = (torch.fft.rfft(a - a.mean(dim=0), dim=0).abs() ** 2).sum(dim=1)
    frequency = torch.fft.rfftfreq(len(a), dt, dtype=torch.float64)
    power[1:] /= frequency[1:] ** 2
    power[frequency < 4.0 / (len(a) * dt)] = 0.0
    share = power.cumsum(dim=0) / power.sum()
    return max(float(frequency[int((share < 0.5).sum())]), 1.0 / (len(a) * dt))
