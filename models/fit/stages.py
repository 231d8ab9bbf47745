"""Stages of a fit on a free run: how far each runs, on what, where it begins, what is chosen.

Models of elements on measured records take a path of their own. Besides fits from the usual starts,
the linear structure is fitted by its free run over longer and longer parts, and from there the
laws are freed step by step: the prior that holds what goes beyond a spring and a damper gets
weaker, and each fit goes on where the one before ended. Held-back motion chooses among them all
(the linear fit has seen it, of which its few parameters make little); from there the fit goes on
over the whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from data.record import SHORTEST, Record
from models.composition.priors import LOOSE
from models.fit.objective import MakeSolver, Note
from models.fit.problem import FreeRunProblem, run_problem
from models.fit.solvers.solver import Minimised
from models.fit.trainable import Trainable
from models.layers.reconstructed import median_line
from models.uncertainty.parameters import free_vector, set_free_vector

Horizons = Sequence[int | None]
PRIORS = (1e-6, 1e-4)  # that are tried from the starts
PATH = (1e-2, 1e-3, 1e-4)  # and from the linear structure, from strong to weak
FEW = (0.3, 1.2, 5.0)  # periods of the median frequency between runs that begin anew,
LONGER = (0.25, 1.0, 3.0, 10.0, 30.0)  # and while the linear structure is fitted
LINEAR_CALLS = 30  # of the solver, for each part
WORSE = 2.0  # times the least loss on held-back motion: the path does not go on from there


@dataclass(frozen=True)
class Stage:
    """One stage of training.

    horizon: samples between runs that begin anew; None: the whole record. last: the horizon is the
    last one. some: on the first records alone. hurried: it ends sooner, for another goes on from
    it. start: number of the ranked start it begins at; None: where the stage before ended.
    finalist: number of the one that it trains. best: it begins where one of them ended, and no end
    before it counts any more. prior: number of the prior that it tries.
    """

    name: str
    horizon: int | None = None
    last: bool = True
    some: bool = False
    hurried: bool = False
    start: int | None = None
    finalist: int | None = None
    best: bool = False
    prior: int | None = None


def usual(horizons: Horizons, finalists: int, trained: bool, more: bool) -> list[Stage]:
    """All horizons for each finalist; to the end, with all records, for the best of them alone.

    trained: there are several starts, which were trained on the first horizon when they were
    ranked. more: there are more records than the stages before the last take.
    """
    later = horizons[1:] if trained and len(horizons) > 1 else horizons
    in_full, stages = more or finalists > 1, []
    numbered = in_full and trained
    for number in range(finalists):
        own = [_named(h, h == horizons[-1]) for h in later]
        own = [replace(s, some=more or not s.last, hurried=in_full) for s in own]
        if numbered:
            own = [replace(s, finalist=number) for s in own]
        own[0] = replace(own[0], start=number)
        if number > 0:
            own = [replace(s, name=f"{s.name}, start {number + 1}") for s in own]
        stages += own
    if in_full:
        name = "the chosen in full" if finalists > 1 else "in full"
        stages.append(replace(_named(horizons[-1], True), name=name, best=numbered))
    return stages


def by_prior(
    horizons: Horizons, priors: Sequence[float], anew: int, near: int | None
) -> list[Stage]:
    """All horizons for each of the first `anew` priors, the path of the others, the refit.

    near: number of the prior whose first runs are of one sample.
    """
    stages = []
    for number, prior in enumerate(priors[:anew]):
        lengths = [1, *horizons[1:]] if number == near else horizons
        own = [_named(h, k + 1 == len(horizons)) for k, h in enumerate(lengths)]
        own[0] = replace(own[0], start=0)
        named = [replace(s, name=f"{s.name}, prior {prior:g}", prior=number) for s in own]
        stages += [replace(stage, some=not stage.last) for stage in named]
    path = [
        Stage(f"from linear, prior {prior:g}", prior=number)
        for number, prior in enumerate(priors[anew:], anew)
    ]
    path[:1] = [replace(stage, start=-1) for stage in path[:1]]
    return [*stages, *path, Stage("whole motion")]


def _named(horizon: int | None, last: bool) -> Stage:
    return Stage(f"horizon {'whole record' if horizon is None else horizon}", horizon, last)


def horizons_of(record: Record, periods: Sequence[float]) -> list[int | None]:
    """Samples between runs that begin anew: some periods of the median frequency, then none."""
    median = median_line(record.a)
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
    best = _whole_loss(estimator, records), free_vector(estimator)
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
            best = loss, free_vector(estimator)
    set_free_vector(estimator, best[1])
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
    return run_problem(estimator, record, horizon, last=False, prior=LOOSE)


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
