"""What a solver minimises, stage by stage: the error of estimates, or of a simulation.

`OneStep` trains on estimates from measured states, `FreeRun` on a run that lives on its own. A free
run of a start far from the truth drifts apart, and its error tells nothing: so the run is begun
anew from measured states, at first often, then seldom, at last never (multiple shooting, as
Ribeiro et al. 2020, On the smoothness of nonlinear system identification).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor, nn

from data.checked import checked
from data.record import Record
from models.estimator import Estimator
from models.training.problem import FreeRunProblem, Problem
from models.training.solvers.solver import Minimised, Solver
from models.training.trainable import Trainable
from models.training.unknown_beginning import UnknownBeginningProblem, begins_unknown

MakeSolver = Callable[[Iterable[nn.Parameter]], Solver]
Note = Callable[[list[float]], None]


class Objective(ABC):
    """Stages of training; each has a solver of its own and starts where the one before ended."""

    stages: Sequence[str]  # in words
    ranked: list[list[Tensor]]  # states of the finalists, the best first

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

    @abstractmethod
    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        """Loss on whole records in the last stage's terms, by which the ends of stages compare."""


class OneStep(Objective):
    """The error of each estimate, in a single stage."""

    stages: Sequence[str] = ("one step",)

    def __init__(self) -> None:
        self.ranked: list[list[Tensor]] = []

    def problem(self, estimator: Trainable, record: Record, stage: int) -> Problem:
        return Problem(estimator, record)

    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Keep the estimator's own start."""

    def enter(self, estimator: Trainable, stage: int) -> None:
        """Do nothing: there is no other stage."""

    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        return _mean_loss([Problem(estimator, record) for record in batches])


@checked
class FreeRun(Objective):
    """The error of a simulation that begins anew every so many samples, a horizon a stage.

    horizons: in samples, rising; None for the whole record. restart: False takes the first samples
    of each record instead, from its own initial state, where x and v are not to be trusted.
    records: number of records that the stages before the last are trained on, None for all.
    warmup: samples that each run takes before its samples count. starts: random starts, drawn from
    `seed`, each trained for `start_iterations` calls of the solver on the first stage. finalists:
    number of starts, those with the lowest training losses, that go through all stages.
    """

    def __init__(
        self,
        horizons: Sequence[int | None] = (50, 500, None),
        restart: bool = True,
        records: int | None = None,
        warmup: int = 0,
        starts: int = 1,
        start_iterations: int = 10,
        finalists: int = 1,
        seed: int = 0,
    ) -> None:
        lengths = [math.inf if h is None else h for h in horizons]
        whole = all(h is None or isinstance(h, int) for h in horizons)
        if not whole or not lengths or min(lengths) < 1 or sorted(lengths) != lengths:
            raise ValueError(
                f"objective.horizons={list(horizons)}: expected numbers of samples that rise, "
                "null at the end for the whole record"
            )
        if warmup < 0 or min(starts, start_iterations) < 1:
            raise ValueError(
                f"objective.warmup={warmup}, starts={starts}, start_iterations={start_iterations}: "
                "expected at least 0, 1 and 1"
            )
        if not 1 <= finalists <= starts:
            raise ValueError(
                f"objective.finalists={finalists} must lie between 1 and objective.starts={starts}"
            )
        if records is not None and records < 1:
            raise ValueError(f"objective.records={records} must be at least 1, or null for all")
        self.horizons, self.warmup = list(horizons), warmup
        self.restart, self.records = restart, records
        self.starts, self.start_iterations, self.seed = starts, start_iterations, seed
        self.ranked: list[list[Tensor]] = []  # states of the finalists, the best first
        stages = [f"horizon {'whole record' if h is None else h}" for h in horizons]
        later = [f"{stage}, start {n}" for n in range(2, finalists + 1) for stage in stages]
        self.stages: Sequence[str] = stages + later

    def problem(self, estimator: Trainable, record: Record, stage: int) -> FreeRunProblem:
        stage %= len(self.horizons)
        horizon, last = self.horizons[stage], stage + 1 == len(self.horizons)
        if not last and record.a.ndim == 3:
            record = record.map(lambda u: u[: self.records])
        if not self.restart and record.initial_state == "periodic":
            horizon = None  # there is no shorter part that begins in the steady state
        elif not self.restart and horizon is not None:
            record, horizon = record.window(0, min(horizon, record.samples), record.warmup), None
        if horizon is None and begins_unknown(estimator, record):
            return UnknownBeginningProblem(estimator, record, last)
        return FreeRunProblem(estimator, record, horizon, self.warmup, last)

    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Rank the starts; the first is that of the estimator itself."""
        if self.starts == 1:
            return
        generator = torch.Generator().manual_seed(self.seed)
        free = [p for p in estimator.parameters() if p.requires_grad]
        identified = state_of(estimator)
        ends: list[tuple[float, list[Tensor]]] = []
        for start in range(self.starts):
            if start > 0:
                restore(estimator, identified)
                estimator.restart(generator)
                estimator.forget()
            self._first_steps(estimator, batches, make_solver(free), note)
            loss = _mean_loss([self.problem(estimator, record, 0) for record in batches])
            ends.append((loss, state_of(estimator)))
        ends.sort(key=lambda end: end[0])
        self.ranked = [state for _, state in ends]
        restore(estimator, self.ranked[0])

    def enter(self, estimator: Trainable, stage: int) -> None:
        """Take the next finalist where the one before has been through all horizons."""
        finalist, first = divmod(stage, len(self.horizons))
        if first == 0:
            restore(estimator, self.ranked[finalist])

    def _first_steps(
        self, estimator: Trainable, batches: Iterable[Record], solver: Solver, note: Note
    ) -> None:
        done = 0
        while True:
            for record in batches:
                note(solver.solve(self.problem(estimator, record, 0)))
                done += 1
                if solver.finished or done == self.start_iterations:
                    return

    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        """Mean loss of the plain free run, without restarts."""
        return _mean_loss([FreeRunProblem(estimator, record, None) for record in batches])


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
def _mean_loss(problems: Sequence[Minimised]) -> float:
    """Mean loss of some problems; infinite where a run diverges."""
    losses: list[Tensor] = [problem.loss() for problem in problems]
    mean = float(torch.stack(losses).mean())
    return mean if math.isfinite(mean) else math.inf
