"""How far the free run may take branch laws away from where equilibrium has them.

The free run sees what equilibrium does not, such as noise of accelerations and errors that add up;
where motions are sensitive it bends the laws to the motions that it sees. So the weight of the
prior around the laws by equilibrium is lowered step by step, on all motions but the largest, and
the one whose free run is nearest to that is taken. The first is next to no polish at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import torch
from torch import Tensor

from data.record import Record
from models.composition.composite import Composite
from models.starts.branch_choice import Joint, minimised, parted
from models.starts.judged import free_run_error
from models.training.objective import restore, state_of
from models.training.problem import FreeRunProblem

WEIGHTS = (1.0, 1e-3, 1e-6)
BY_DEFAULT = 1e-6  # where no free run can be judged
STEPS, CHANGE, PATIENCE, EVERY = 8, 2e-2, 3, 4


def polish_weight(
    model: Composite, records: Sequence[Record], largest: int
) -> tuple[float, dict[str, float | str]]:
    """The weight of the prior, and what was found; the model is left as it was.

    largest: number of the motion that is judged by.
    """
    rest, judged = parted(motions_of(records), largest)
    before = state_of(model)
    errors: list[float] = []
    with torch.no_grad():
        error = free_run_error(model, [judged])
    if error is None:
        return BY_DEFAULT, {}
    start, weight = error, WEIGHTS[0]
    for weight in WEIGHTS:
        problems = [FreeRunProblem(model, record, None, prior=weight) for record in rest]
        minimised(model, Joint(problems), STEPS, EVERY, CHANGE, PATIENCE)
        error = free_run_error(model, [judged])
        errors.append(math.inf if error is None else error)
    restore(model, before)
    best = min(range(len(WEIGHTS)), key=errors.__getitem__)
    told = ", ".join(f"{100.0 * e:.2f}" for e in (start, *errors))
    return WEIGHTS[best], {"prior": WEIGHTS[best], "held_back_percent": told}


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
