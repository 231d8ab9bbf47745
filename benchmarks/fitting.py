"""A model fitted to records as train.py fits it, and its error in free run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import torch

from data import Record, Sensors
from models import Estimator
from models.experiment import Experiment
from models.fit.objective import restore, state_of
from models.fit.solvers.solver import hurry
from models.fit.trainable import require_trainable
from runner.config.choices import plain
from runner.config.compose import composed


def fit(words: Sequence[str], batch: Record) -> tuple[Estimator, dict[str, Any]]:
    """The model of a command line, fitted to a batch; and what its identification reports."""
    experiment = _experiment(tuple(words))
    inputs = batch.excitation.shape[-1]
    estimator = experiment.model.estimator(Sensors(batch.dt, batch.dofs, inputs))
    facts = estimator.identify([batch])
    free = [p for p in estimator.parameters() if p.requires_grad]
    if not free:
        return estimator, facts
    trainable = require_trainable(estimator)
    objective, make_solver = experiment.make_objective(), experiment.make_solver()
    objective.prepare(trainable, [batch], measured=False)
    ends = [(objective.final_loss(trainable, [batch]), state_of(trainable))]
    objective.begin(trainable, [batch], make_solver, lambda losses: None)
    stage = 0
    while stage < len(objective.stages):  # which may become more
        if stage > 0:
            objective.enter(trainable, stage)
            if objective.goes_back:
                restore(trainable, min(ends, key=lambda end: end[0])[1])
            if objective.refits:
                ends = [(objective.final_loss(trainable, [batch]), state_of(trainable))]
        solver = make_solver(free)
        if objective.hurries:
            hurry(solver)
        while not solver.finished:
            solver.solve(objective.problem(trainable, batch, stage))
        ends.append((objective.final_loss(trainable, [batch]), state_of(trainable)))
        stage += 1
    restore(trainable, min(ends, key=lambda end: end[0])[1])
    objective.refine(trainable, [batch], lambda losses: None)
    return estimator, facts


@cache
def _experiment(words: tuple[str, ...]) -> Experiment:
    return Experiment.of(plain(composed(*words)))


@torch.no_grad()
def free_run_error(model: Estimator, records: Sequence[Record]) -> float:
    """Relative RMS error of free runs over all records [%]; not finite where one diverged."""
    errors = sum(float(((model.free_run(r.drive()).a - r.a) ** 2).sum()) for r in records)
    return 100.0 * (errors / sum(float((r.a**2).sum()) for r in records)) ** 0.5
