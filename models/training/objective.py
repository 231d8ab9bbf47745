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
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from data.checked import checked
from data.record import Record
from models.estimator import Estimator
from models.training.parts import SHORTEST, held_back_from, onset
from models.training.problem import FreeRunProblem, Problem
from models.training.solvers.solver import Minimised, Solver
from models.training.trainable import Trainable
from models.training.unknown_beginning import UnknownBeginningProblem, begins_unknown

PARTS = (0.125, 0.25, 0.5)  # of the motion, in stages, where runs cannot begin anew
PRIORS = (1e-6, 1e-4, 1e-2)  # that are tried beside a model's own
MORE, BOUND = 1.5, 10.0  # times the excitation, and times the motion, that a model has to stand
RUNAWAY = 1e4  # loss of one that does not, beside its own: it comes last
LEAST_RAISED = 1e-8  # of a prior that is raised
REFIT = "whole motion"
MakeSolver = Callable[[Iterable[nn.Parameter]], Solver]
Note = Callable[[list[float]], None]


class Objective(ABC):
    """Stages of training; each has a solver of its own and starts where the one before ended."""

    stages: Sequence[str]  # in words
    kept: tuple[str, ...] = ()  # attributes that a checkpoint holds
    shorter = 0  # how often the horizon of the present stage was halved
    raised = 1.0  # what the prior of the present stage is multiplied by
    remarks: Sequence[str] = ()  # on what was done unasked

    @abstractmethod
    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        """Called first, also where training goes on; `measured`: by sensors, not simulated."""

    @property
    def refits(self) -> bool:
        """The present stage goes on from the best state so far, on all of the motion."""
        return False

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

    @abstractmethod
    def final_loss(self, estimator: Trainable, batches: Iterable[Record]) -> float:
        """Loss on whole records in the last stage's terms, by which the ends of stages compare."""


class OneStep(Objective):
    """The error of each estimate, in a single stage."""

    stages: Sequence[str] = ("one step",)

    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        """Do nothing."""

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
    of each record instead, from its own initial state, where x and v are not to be trusted; so it
    is, over growing parts of the motion, where there is no x and v. A quiet start is no part of
    such a horizon.
    records: number of records that the stages before the last are trained on, None for all.
    warmup: samples that each run takes before its samples count. starts: random starts, drawn from
    `seed`, each trained for `start_iterations` calls of the solver on the first stage. finalists:
    number of starts, those with the lowest training losses, that go through all stages.
    select: weights of the prior that are tried on all but the last `held_back` of the motion; the
    one with the least error of the free run on that goes on, on the whole; one that runs away under
    half as much excitation again comes last. None: some beside the model's own where records were
    measured; []: no others. It takes the place of finalists.
    """

    kept = ("ranked", "judged", "shorter", "raised", "present", "remarks")

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
        select: Sequence[float] | None = None,
        held_back: float = 0.2,
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
        if not 0.0 < held_back < 1.0 or min(select or [0.0]) < 0.0:
            raise ValueError(
                f"objective.held_back={held_back}, select={select}: expected a fraction between 0 "
                "and 1, and weights of the prior that are not negative"
            )
        self.horizons, self.warmup = list(horizons), warmup
        self.restart, self.records = restart, records
        self.starts, self.start_iterations, self.seed = starts, start_iterations, seed
        self.finalists, self.select, self.held_back = finalists, select, held_back
        self.priors: list[float] = []  # that are tried
        self.ranked: list[list[Tensor]] = []  # states of the finalists, the best first
        self.judged: list[list[float]] = []  # number of a prior, loss on held-back motion
        self.present = -1  # the stage, −1 before the first
        self.remarks: list[str] = []
        self._name_stages()

    def _name_stages(self) -> None:
        stages = [f"horizon {'whole record' if h is None else h}" for h in self.horizons]
        later = [f"{s}, start {n}" for n in range(2, self.finalists + 1) for s in stages]
        self.stages: Sequence[str] = stages + later
        if self.priors:
            tried = [f"{s}, prior {p:g}" for p in self.priors for s in stages]
            self.stages = [*tried, REFIT]

    def prepare(self, estimator: Trainable, batches: Iterable[Record], measured: bool) -> None:
        records = list(batches)
        anew = self.restart and self.horizons != [None]
        if anew and not all(estimator.has_states(record) for record in records):
            self._grow(min(record.samples - onset(record) for record in records))
        own, deviation = estimator.pull(True)
        if deviation.numel() and (self.select or (self.select is None and measured)):
            tried = self.select or (own, *PRIORS)
            self.priors = list(dict.fromkeys(float(p) for p in tried))
        self._name_stages()

    def _grow(self, samples: int) -> None:
        """Parts of a motion of so many samples, where runs cannot begin anew."""
        self.restart = False
        lengths = dict.fromkeys(max(SHORTEST, round(part * samples)) for part in PARTS)
        self.horizons = [*(length for length in lengths if length < samples), None]
        parts = _listed(self.horizons)
        self.remarks = [f"without x and v no run begins anew; stages take the first {parts}"]

    @property
    def refits(self) -> bool:
        """The present stage goes on, on the whole motion, with the prior that did best."""
        return bool(self.priors) and self.present + 1 == len(self.stages)

    def facts(self) -> dict[str, Any]:
        if not self.judged:
            return super().facts()
        least = [
            min((e for t, e in self.judged if t == i), default=math.inf)
            for i in range(len(self.priors))
        ]
        percent = {
            f"{p:g}": 100.0 * e**0.5 if math.isfinite(e) else None
            for p, e in zip(self.priors, least, strict=True)
        }
        return {**super().facts(), "prior": self.priors[self.best], "held_back_percent": percent}

    @property
    def judges(self) -> bool:
        """The present stage is judged on motion that was held back."""
        return bool(self.priors) and not self.refits

    def _prior(self, stage: int) -> float | None:
        """The weight of the prior in a stage; None for the model's own."""
        if not self.priors:
            return None
        tried = self.best if stage + 1 == len(self.stages) else stage // len(self.horizons)
        return self.priors[tried]

    @property
    def best(self) -> int:
        """Number of the prior with the least loss on held-back motion."""
        losses = [(loss, int(tried)) for tried, loss in self.judged if tried >= 0]
        return min(losses)[1] if losses else 0

    def problem(self, estimator: Trainable, record: Record, stage: int) -> FreeRunProblem:
        prior = self._prior(stage)
        if self.priors and stage + 1 == len(self.stages):
            stage = len(self.horizons) - 1
        elif self.priors:
            record = record.window(0, held_back_from(record, self.held_back), record.warmup)
        if self.raised > 1.0:
            prior = self.raised * max(
                LEAST_RAISED, estimator.pull(True)[0] if prior is None else prior
            )
        stage %= len(self.horizons)
        horizon, last = self.horizons[stage], stage + 1 == len(self.horizons)
        if not last and record.a.ndim == 3:
            record = record.map(lambda u: u[: self.records])
        quiet = 0 if self.restart else onset(record)
        if self.shorter:
            last = False
            length = record.samples - quiet if horizon is None else min(horizon, record.samples)
            horizon = max(SHORTEST if not self.restart else 1, length >> self.shorter)
        if not self.restart and record.initial_state == "periodic":
            horizon = None  # there is no shorter part that begins in the steady state
        elif horizon is not None and not (self.restart and estimator.has_states(record)):
            length = horizon + (quiet if 2 * quiet > horizon else 0)
            record, horizon = record.window(0, min(length, record.samples), record.warmup), None
        if horizon is None and begins_unknown(estimator, record):
            return UnknownBeginningProblem(estimator, record, last, prior)
        return FreeRunProblem(estimator, record, horizon, self.warmup, last, prior)

    def begin(
        self, estimator: Trainable, batches: Iterable[Record], make_solver: MakeSolver, note: Note
    ) -> None:
        """Rank the starts; the first is that of the estimator itself."""
        self.present = 0
        if self.starts == 1:
            self.ranked = [state_of(estimator)]
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
        """Take the next finalist, or the next prior, where one has been through all horizons."""
        self.present, self.shorter, self.raised = stage, 0, 1.0
        finalist, first = divmod(stage, len(self.horizons))
        if first == 0 and not self.refits:
            restore(estimator, self.ranked[0 if self.priors else finalist])

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
        """Mean loss of the plain free run, without restarts; on held-back motion while priors are
        tried."""
        if not self.priors:
            return _mean_loss([FreeRunProblem(estimator, record, None) for record in batches])
        problems = []
        for record in batches:
            if self.judges:
                record = replace(record, warmup=held_back_from(record, self.held_back))
            problems.append(FreeRunProblem(estimator, record, None, prior=0.0))
        stands = all(stands_more(estimator, problem.record) for problem in problems)
        loss = _mean_loss(problems) + (0.0 if stands else RUNAWAY)
        if self.judges:
            tried = -1 if self.present < 0 else self.present // len(self.horizons)
            self.judged = [*self.judged, [tried, loss]]
        return loss


@torch.no_grad()
def stands_more(estimator: Trainable, record: Record) -> bool:
    """Whether a free run stays within bounds where the excitation is MORE times that of a record.

    A law that was bent to fit one motion may run away from the next; no error on the first says so.
    """
    drive = record.drive()
    more = replace(drive, u=MORE * drive.u, x0=MORE * drive.x0, v0=MORE * drive.v0)
    largest = estimator.free_run(more).a.abs().max() / record.a.abs().max()
    return bool(largest < BOUND * MORE)  # which NaN is not


def _listed(horizons: Sequence[int | None]) -> str:
    return ", ".join("the whole record" if h is None else str(h) for h in horizons) + " samples"


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
