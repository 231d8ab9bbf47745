"""Fits of free runs from rest to a growing share of a motion's energy.

Where accelerations alone were measured, displacements and velocities from which a run could restart
are integrals of noise. A run from rest over a short part of the motion needs none; a fit to that
part is the start of the fit to a longer one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from data.record import SHORTEST, Record
from models.fit.blocks import is_noise
from models.fit.minimise import minimise
from models.fit.objective import MakeSolver, restore, state_of
from models.fit.problem import FreeRunProblem, Joint, run_problem
from models.fit.progress import announce, is_out_of_time
from models.fit.solvers.levenberg_marquardt import LevenbergMarquardt
from models.fit.stages import LONGER, PRIORS, fit_linear, horizons_of
from models.fit.trainable import Trainable

SHARES = (0.01, 0.03, 0.1, 0.3, 1.0)  # of the energy
SETTINGS: dict[str, Any] = {"iterations": 40, "every": 4, "change": 1e-2, "patience": 5}


def lack_states(estimator: Trainable, records: Sequence[Record]) -> bool:
    """Whether an estimator reads accelerations alone of the records."""
    return all(
        record.quantity == "acceleration" and not estimator.has_states(record) for record in records
    )


@torch.no_grad()
def grow(estimator: Trainable, records: Sequence[Record]) -> float:
    """Fit an estimator from its start and from its linear structure; keep the fit of least error.

    The first share is a tenth of the energy. While the residual is more than noise, fits that
    start with smaller shares follow. Returns the relative error of the free run of the whole
    motions; infinite where all runs diverge.
    """
    announce("runs from rest over a growing part of the motion")
    starts, ends = [state_of(estimator)], list[tuple[float, list[Tensor]]]()
    for first, linear in product(range(len(SHARES) - 3, -1, -1), (False, True)):
        if ends and is_out_of_time():
            break
        restore(estimator, starts[-1 if linear else 0])
        if linear and len(starts) == 1:
            shortest = min(records, key=lambda record: record.samples)
            solver = cast(MakeSolver, partial(LevenbergMarquardt, **SETTINGS))
            fit_linear(
                estimator, records, horizons_of(shortest, LONGER), solver, lambda losses: None
            )
            starts.append(state_of(estimator))
        for share in SHARES[first:]:
            parts = [_beginning(record, share) for record in records]
            last = share == SHARES[-1]
            problems = [run_problem(estimator, part, None, last, PRIORS[0]) for part in parts]
            minimise(Joint(problems), SETTINGS)
        errors = [FreeRunProblem(estimator, record, None).errors().numpy() for record in records]
        left = np.concatenate(errors) / math.sqrt(sum(map(len, errors)))
        error = float(np.linalg.norm(left))
        ends.append((error if math.isfinite(error) else math.inf, state_of(estimator)))
        if is_noise(left, channels=records[0].a.shape[-1]):
            break
    error, state = min(ends, key=lambda end: end[0])
    restore(estimator, state)
    return error


def _beginning(record: Record, share: float) -> Record:
    """The record until each of its motions has reached such a share of its energy.

    A periodic record, which is in its steady state throughout, is returned whole.
    """
    if record.initial_state == "periodic":
        return record
    squares = record.counted(record.a).square().sum(dim=-1)
    energy = squares.reshape(-1, squares.shape[-1]).cumsum(dim=-1)
    reached = (energy < share * (1.0 - 1e-9) * energy[:, -1:]).sum(dim=-1) + 1
    samples = record.warmup + int(reached.max())
    return record.window(0, min(max(samples, SHORTEST), record.samples), record.warmup)
