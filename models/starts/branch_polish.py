"""How far the free run may take branch laws away from where equilibrium has them.

The free run sees what equilibrium does not, such as noise of accelerations and errors that add up;
where motions are sensitive it bends the laws to the motions that it sees. So the weight of the
prior around the laws by equilibrium is lowered step by step, on all motions but the largest, and
the weakest is taken whose free run is as near to that as any but for HARM: a law that goes beyond
what it was fitted to is so far off that small gains do not show there, and harm does. A polished
model also has to stand that motion 1.5 times as large, and a tenth of it; where none does, the laws
by equilibrium are no good, and the free run has its way. The first weight is next to no polish.

Where accelerations alone were measured, what is slow in the motion is lost to equilibrium, laws are
a tenth off, and free runs of them drift away. Runs then begin anew at the reconstructed motion
first, ever more seldom, so that the free run may teach the laws what is slow.

What a law does where no motion of training led it is chance, and another start of it does something
else there: where laws run away under motions like those of training, they are fitted anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import torch
from torch import Tensor

from data.record import Record
from models.composition.composite import Composite
from models.fit.doing import doing
from models.fit.objective import restore, state_of
from models.fit.problem import FreeRunProblem
from models.fit.stands import stands
from models.starts.branch_choice import HARM, Joint, minimised, parted
from models.starts.equilibrium import dominant
from models.starts.judged import farthest, free_run_error

WEIGHTS = (1.0, 1e-3, 1e-6)
BY_DEFAULT = 1e-6  # where no free run can be judged, or none stands
RECONSTRUCTED = (1e-3, 1e-4, 1e-5)  # the weights, where accelerations alone were measured
STEPS, CHANGE, PATIENCE, EVERY = 8, 2e-2, 3, 4
GROWING = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)  # periods from one beginning to the next
GROWING_STEPS = 15
FAR, FITS = 4.0, 3  # times a motion, beyond which laws run away; fits until none does
Facts = dict[str, float | str]


def until_it_stands(
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
        if ends[-1][0] <= FAR:
            break
        seed = int(torch.randint(2**31, (1,), generator=generator))
    far, state, facts = min(ends, key=lambda end: end[0])
    restore(model, state)
    ran_away = len(ends) - (far <= FAR)
    return facts | ({"fits_that_ran_away": f"{ran_away} of {len(ends)}"} if ran_away else {})


def polish_weight(model: Composite, records: Sequence[Record], largest: int) -> tuple[float, Facts]:
    """The weight of the prior, and what was found; the model is left as it was.

    largest: number of the motion that is judged by.
    """
    rest, judged = parted(motions_of(records), largest)
    before, reconstructed = state_of(model), are_reconstructed(model, records)
    start = free_run_error(model, [judged])
    if start is None and not reconstructed:
        return BY_DEFAULT, {}
    if reconstructed:
        grow(model, rest, RECONSTRUCTED[0])
    ends = []
    for weight in RECONSTRUCTED if reconstructed else WEIGHTS:
        doing(f"the free run of all laws, prior {weight:g}")
        problems = [FreeRunProblem(model, record, None, prior=weight) for record in rest]
        minimised(model, Joint(problems), STEPS, EVERY, CHANGE, PATIENCE)
        ends.append((*_judged(model, judged), weight))
    restore(model, before)
    falls, least, _ = min(ends)
    weight = min(w for fell, error, w in ends if fell == falls and error <= HARM * least)
    errors = [math.inf if start is None else start, *(error for _, error, _ in ends)]
    told = ", ".join(f"{100.0 * e:.2f}" for e in errors)
    weight = BY_DEFAULT if falls else weight
    return weight, {"prior": weight, "held_back_percent": told}


def are_reconstructed(model: Composite, records: Sequence[Record]) -> bool:
    """Whether x and v come from accelerations, and runs can begin anew at them."""
    measured = all(model.has_states(record) for record in records)
    return not measured and all(model.begins_anew(record) for record in records)


def grow(model: Composite, motions: Sequence[Record], weight: float) -> None:
    """Fit all laws to runs that begin anew, at first every few samples, then ever more seldom."""
    doing("runs of all laws, longer and longer")
    period = min(1.0 / (dominant(motion.a, motion.dt) * motion.dt) for motion in motions)
    for horizon in dict.fromkeys(max(2, round(share * period)) for share in GROWING):
        problems = [FreeRunProblem(model, motion, horizon, prior=weight) for motion in motions]
        minimised(model, Joint(problems), GROWING_STEPS, EVERY, CHANGE, PATIENCE)


def _judged(model: Composite, record: Record) -> tuple[bool, float]:
    """Whether the model falls under larger or smaller motions, and the error of its free run."""
    error = free_run_error(model, [record])
    return not stands(model, record), math.inf if error is None else error


def motions_of(records: Sequence[Record]) -> list[Record]:
    """Every motion as a record of its own."""
    motions = []
    for record in records:
        lead = record.a.shape[:-2]
        for i in range(lead.numel()):
            motions.append(record.map(partial(_motion, i)) if lead else record)
    return motions


def _motion(i: int, signal: Tensor) -> Tensor:
    """Motion i (T, c) of a signal (…, T, c)."""
    return signal.reshape(signal.shape[:-2].numel(), *signal.shape[-2:])[i]
