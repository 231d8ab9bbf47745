"""Training of models of elements on measured records: what is tried, what is chosen.

Besides fits from the usual starts, the linear structure is fitted by its free run over longer and
longer parts, and from there the laws are let go step by step: the prior that holds what goes beyond
a spring and a damper gets weaker, and each fit goes on where the one before ended. What was held
back of the training motion chooses among them all (the linear fit has seen it, of which its few
parameters make little); from there the fit goes on over the whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from data.record import Record
from models.fit.objective import MakeSolver, Note
from models.fit.parts import SHORTEST
from models.fit.problem import FreeRunProblem
from models.fit.solvers.solver import Minimised
from models.fit.trainable import Trainable
from models.fit.unknown_beginning import run_problem

PRIORS = (1e-6, 1e-4)  # that are tried from the starts
PATH = (1e-2, 1e-3, 1e-4)  # and from the linear structure, from strong to weak
FEW = (0.3, 1.2, 5.0)  # periods of the median frequency between runs that begin anew,
LONGER = (0.25, 1.0, 3.0, 10.0, 30.0)  # and while the linear structure is fitted
LINEAR = 1e-6  # weight of the prior of the linear fit, for what no motion tells
LINEAR_CALLS = 30  # of the solver, for each part
WORSE = 2.0  # times the least loss on held-back motion: the path does not go on from there


def horizons_of(record: Record, periods: Sequence[float]) -> list[int | None]:
    """Samples between runs that begin anew: some periods of the median frequency, then none."""
    power = torch.fft.rfft(record.a, dim=-2).abs().square()
    power = power.sum(dim=-1).reshape(-1, power.shape[-2]).sum(dim=0).cumsum(dim=0)
    median = max(1, int(torch.searchsorted(power, 0.5 * power[-1:])))
    lengths = dict.fromkeys(max(2, round(p * record.samples / median)) for p in periods)
    return [*(length for length in lengths if length < record.samples), None]


def fit_linear(
    estimator: Trainable,
    records: Sequence[Record],
    horizons: Sequence[int | None],
    make_solver: MakeSolver,
    note: Note,
) -> None:
    """Fit the linear structure of an estimator; keep the best by its free run of whole records."""
    estimator.let_go(linear_alone=True)
    free = [p for p in estimator.parameters() if p.requires_grad]
    best = _whole_loss(estimator, records), [p.detach().clone() for p in free]
    for horizon in horizons:
        solver = make_solver(free)
        problems = [_part(estimator, record, horizon) for record in records]
        for _ in range(LINEAR_CALLS):
            for problem in problems:
                note(solver.solve(problem))
            if solver.finished:
                break
        loss = _whole_loss(estimator, records)
        if loss < best[0]:
            best = loss, [p.detach().clone() for p in free]
    with torch.no_grad():
        for parameter, value in zip(free, best[1], strict=True):
            parameter.copy_(value)
    estimator.let_go(linear_alone=False)
    estimator.settle()


def _part(estimator: Trainable, record: Record, horizon: int | None) -> Minimised:
    """A fit that begins anew every so many samples; where none can, of the first so many."""
    if horizon is not None and not estimator.begins_anew(record):
        if record.initial_state == "periodic":
            horizon = None
        else:
            record = record.window(0, max(SHORTEST, horizon), record.warmup)
            horizon = None
    return run_problem(estimator, record, horizon, last=False, prior=LINEAR)


def _whole_loss(estimator: Trainable, records: Sequence[Record]) -> float:
    with torch.no_grad():
        losses = [FreeRunProblem(estimator, r, None, prior=0.0).loss() for r in records]
        mean = float(torch.stack(losses).mean())
    return mean if math.isfinite(mean) else math.inf


def best_of(judged: Sequence[Sequence[float]]) -> int:
    """Number of the prior with the least loss on held-back motion."""
    losses = [(loss, int(tried)) for tried, loss in judged if tried >= 0]
    return min(losses)[1] if losses else 0


def held_back_percent(
    names: Sequence[str], judged: Sequence[Sequence[float]]
) -> dict[str, float | None]:
    """Error on held-back motion in percent, of all that was tried; None where it is not finite."""
    least = [min((e for t, e in judged if t == i), default=math.inf) for i in range(len(names))]
    return {
        name: 100.0 * e**0.5 if math.isfinite(e) else None
        for name, e in zip(names, least, strict=True)
    }
