"""Fits to a growing share of a motion's energy: from rest, without any state but the first.

Where accelerations alone were measured, runs cannot begin again at states that are worth it. Over a
short beginning a run from rest does not drift far, and what fits there is near enough to go on.
T samples, n outputs.
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

from data.record import Record
from models.fit.blocks import is_noise
from models.fit.held_back import SHORTEST
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
    """Whether accelerations are all that an estimator knows of the records' motion."""
    return all(
        record.quantity == "acceleration" and not estimator.has_states(record) for record in records
    )


@torch.no_grad()
def grow(estimator: Trainable, records: Sequence[Record]) -> float:
    """Fit an estimator from its start and from its linear structure; the nearest run is kept.

    From a tenth of the energy on at first, and where no run leaves noise alone, from less.
    Returns the relative error of the run of the whole motions; infinite where all diverge.
    """
    announce("runs from rest over a growing part of the motion")
    begin, ends = state_of(estimator), list[tuple[float, list[Tensor]]]()
    for first, from_linear in product(range(len(SHARES) - 3, -1, -1), (False, True)):
        if ends and is_out_of_time():
            break
        restore(estimator, begin)
        if from_linear:
            shortest = min(records, key=lambda record: record.samples)
            solver = cast(MakeSolver, partial(LevenbergMarquardt, **SETTINGS))
            fit_linear(
                estimator, records, horizons_of(shortest, LONGER), solver, lambda losses: None
            )
        for share in SHARES[first:]:
            parts = [_beginning(record, share) for record in records]
            last = share == SHARES[-1]
            problems = [run_problem(estimator, part, None, 0, last, PRIORS[0]) for part in parts]
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
    """All motions of a record until each has had such a share of its energy.

    A steady state has no beginning.
    """
    if record.initial_state == "periodic":
        return record
    counted = record.a[..., record.warmup :, :].square().sum(dim=-1)
    energy = counted.reshape(-1, counted.shape[-1]).cumsum(dim=-1)
    reached = (energy < share * (1.0 - 1e-9) * energy[:, -1:]).sum(dim=-1) + 1
    samples = record.warmup + int(reached.max())
    return record.window(0, min(max(samples, SHORTEST), record.samples), record.warmup)
