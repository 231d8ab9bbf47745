"""What a solver minimises, stage by stage: the error of estimates, or of a simulation.

`OneStep` trains on estimates from measured states, `FreeRun` (free_run_objective.py) on a run that
lives on its own.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from data.record import Record
from models.estimator import Estimator
from models.fit.problem import Problem
from models.fit.solvers.solver import Minimised, Solver
from models.fit.trainable import Trainable

MakeSolver = Callable[[Iterable[nn.Parameter]], Solver]
Note = Callable[[list[float]], None]


class Objective(ABC):
    """Stages of training; each has a solver of its own and starts where the one before ended."""

    stages: Sequence[str]  # in words
    simulates = False  # whether it is the error of a free run
    kept: tuple[str, ...] = ()  # attributes that a checkpoint holds
    shorter = 0  # how often the horizon of the present stage was halved
    raised = 1.0  # what the prior of the present stage is multiplied by
    remarks: Sequence[str] = ()  # on what was done unasked
    near: list[Tensor] | None = None  # a state fitted before all stages; may be the best
    firm: float | None = None  # weight of the prior where training begins at given weights

    @abstractmethod
    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        """Called first, also where training goes on; `measured`: by sensors, not simulated."""

    @property
    def goes_back(self) -> bool:
        """The present stage begins at the best state so far."""
        return False

    @property
    def hurries(self) -> bool:
        """The present stage may end sooner: another goes on from it."""
        return False

    @property
    def refits(self) -> bool:
        """The present stage is the last, on all of the motion; ends before it do not count."""
        return False

    @property
    def held_back_loss(self) -> float | None:
        """The least loss on held-back motion of all that was tried; None where none was judged."""
        return None

    def facts(self) -> dict[str, Any]:
        """What was done unasked, for `metrics.json`."""
        return {"remarks": list(self.remarks)} if self.remarks else {}

    @abstractmethod
    def problem(self, estimator: Trainable, record: Record, stage: int) -> Minimised:
        """What the solver of a stage minimises on a batch."""

    @abstractmethod
    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Choose the start of the first stage; `note` is handed the accepted losses."""

    @abstractmethod
    def enter(self, estimator: Trainable, stage: int) -> None:
        """Called before every stage but the first."""

    def refine(self, estimator: Trainable, batches: Iterable[Record], note: Note) -> None:
        """Go on from a finished fit by what only such a fit can tell; by default nothing."""
        return

    def require_one_batch(self, estimator: Trainable) -> None:
        """Raise ValueError where what is asked for needs all windows at once."""
        return

    @abstractmethod
    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        """Loss on whole records in the last stage's terms, by which the ends of stages compare."""


class OneStep(Objective):
    """The error of each estimate, in a single stage."""

    stages: Sequence[str] = ("one step",)
    last: tuple[Estimator, Record, Problem] | None = None

    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        """Do nothing."""

    def problem(self, estimator: Trainable, record: Record, stage: int) -> Problem:
        if self.last is None or self.last[0] is not estimator or self.last[1] is not record:
            self.last = estimator, record, Problem(estimator, record)
        return self.last[2]

    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Keep the estimator's own start."""

    def enter(self, estimator: Trainable, stage: int) -> None:
        """Do nothing: there is no other stage."""

    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        return mean_loss([Problem(estimator, record) for record in batches])


def state_of(estimator: Estimator) -> list[Tensor]:
    """Parameters and buffers: a start may choose units as well as weights."""
    return [t.detach().clone() for t in (*estimator.parameters(), *estimator.buffers())]


@torch.no_grad()
def restore(estimator: Estimator, state: list[Tensor]) -> None:
    """Set parameters and buffers to a state that `state_of` returned."""
    for tensor, value in zip((*estimator.parameters(), *estimator.buffers()), state, strict=True):
        tensor.copy_(value)
    if isinstance(estimator, Trainable):
        estimator.forget()


@torch.no_grad()
def mean_loss(problems: Sequence[Minimised]) -> float:
    """Mean loss of some problems; infinite where a run diverges."""
    losses: list[Tensor] = [problem.loss() for problem in problems]
    mean = float(torch.stack(losses).mean())
    return mean if math.isfinite(mean) else math.inf
