"""The one LightningModule: fits and scores any estimator.

First the closed form, then a solver for whatever parameters are left. An estimator that has none
left stops there; nothing here asks which estimator it is.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from statistics import fmean
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from data.record import Record
from models.estimator import Estimator
from models.fit.metrics import FREE_RUNS, FreeRunScore, Scores, free_run_score
from models.fit.objective import Objective, OneStep, restore, state_of
from models.fit.problem import FreeRunProblem
from models.fit.progress import is_out_of_time, present_budget
from models.fit.solvers.solver import Minimised, Solver, hurry
from models.fit.trainable import Trainable, require_trainable
from models.uncertainty.laplace import Laplace

SPLITS = ("train", "test")  # order of the datamodule's test loaders,
HELD_BACK = "validation"  # the last of them, where there is one; scored one step ahead
# by a checkpoint
KEPT = ("stage", "tried", "ended", "chosen", "losses", "best", "fails", "rescued")
MOST_RESCUES, MOST_HALVINGS = 3, 8  # of a stage whose run diverges at its start
HELD = 1e-5  # weight of the prior around given weights: a few percent of noise on 20 s of motion
FIRMER = 100.0  # times the prior, where training goes back


class Identification(LightningModule):
    """`solver` makes a solver from the parameters that the closed form leaves free.

    Where the datamodule holds back a part of the training motion for validation, training stops
    after `max_fail` checks without a better one, and the best parameters are kept. A check follows
    each call of the solver: an iteration of Levenberg–Marquardt, some twenty of L-BFGS, an epoch
    of Adam.

    Training never ends at a state that diverges where it has seen one that does not: a stage whose
    run is not finite at its start goes back to the best state so far, or to shorter horizons.

    `objective` says what is minimised, in how many stages; each stage has a solver of its own. Of
    several stages, the parameters are kept that simulate the whole training motion best, or what
    the datamodule holds back.
    """

    def __init__(
        self,
        estimator: Estimator,
        solver: Callable[[Iterable[nn.Parameter]], Solver] | None = None,
        max_fail: int = 6,
        objective: Objective | None = None,
    ) -> None:
        super().__init__()
        if max_fail < 1:
            raise ValueError(f"max_fail={max_fail} must be at least 1")
        self.automatic_optimization = False
        self.estimator, self.make_solver, self.max_fail = estimator, solver, max_fail
        self.objective: Objective = OneStep() if objective is None else objective
        self.solver: Solver | None = None
        self.stage, self.tried = 0, 0  # iterations that random starts took
        self.ended: list[dict[str, Any]] = []  # stages: name, iterations, why they stopped
        self.chosen: tuple[float, list[Tensor]] = (float("inf"), [])  # of the stages' ends
        self.losses: list[float] = []  # Eq. 21 squared, after every accepted iteration
        self.solution: dict[str, float | str] = {}  # what the closed form says of itself
        self.held = HELD  # how firmly such weights are held, where the model has a prior
        self.begun_at = ""  # whose weights training begins at, in place of the closed form
        self.fit_seconds = 0.0
        self.best: tuple[float, dict[str, Tensor]] = (float("inf"), {})
        self.fails = 0
        self.rescued = 0  # how often the present stage was restarted
        self.validated: list[float] = []  # losses of the records of a validation
        self.broken_off: dict[str, Any] = {}  # a checkpoint to go on from
        self.minimum: Laplace | None = None  # what intervals are made of, once it is known
        self.scores: dict[str, Scores] = {}
        self.free_runs: dict[str, FreeRunScore] = {}
        self.examples: dict[str, tuple[Record, dict[str, Tensor]]] = {}  # first batch, estimates

    def free_parameters(self) -> dict[str, nn.Parameter]:
        return {name: p for name, p in self.estimator.named_parameters() if p.requires_grad}

    @property
    def trainable(self) -> Trainable:
        """The estimator, which has free parameters."""
        return require_trainable(self.estimator)

    def configure_optimizers(self) -> list[Any]:
        if not self.free_parameters():
            return []
        if self.make_solver is None:
            raise ValueError(
                f"{type(self.estimator).__name__} has free parameters; choose a solver"
            )
        self.solver = self.make_solver(self.free_parameters().values())
        return [self.solver]

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Beside the parameters, all that training goes on from."""
        assert self.solver is not None
        kept = {name: getattr(self, name) for name in KEPT}
        solver = {name: getattr(self.solver, name) for name in self.solver.kept}
        checkpoint["progress"] = {
            **{"identification": kept, "solver": solver, "memory": self.solver.state_dict()},
            "objective": {name: getattr(self.objective, name) for name in self.objective.kept},
            "random": torch.get_rng_state(),
            "seconds": time.perf_counter() - self.start,
        }

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        self.broken_off = checkpoint

    def _go_on(self) -> None:
        """As if training had never been broken off: its end is the same."""
        self.load_state_dict(self.broken_off["state_dict"])
        progress = self.broken_off["progress"]
        for name in KEPT:
            setattr(self, name, progress["identification"][name])
        for name in self.objective.kept:
            setattr(self.objective, name, progress["objective"][name])
        self.solver = self._new_solver(self.free_parameters().values())
        self.solver.load_state_dict(progress["memory"])
        for name in self.solver.kept:
            setattr(self.solver, name, progress["solver"][name])
        torch.set_rng_state(progress["random"])  # windows are shuffled as they would have been
        self.start -= progress["seconds"]
        present_budget().end -= progress["seconds"]

    def on_fit_start(self) -> None:
        self.start = time.perf_counter()
        loader = self.trainer.datamodule.train_dataloader()  # type: ignore[attr-defined]
        if self.begun_at:
            self.solution = {"start": self.begun_at}
            self.trainable.keep_start()
            self.objective.firm = self.held
        else:
            self.solution = self.estimator.identify(OnDevice(loader, self.device))
        if self.solver is not None:
            measured = self.trainer.datamodule.measured  # type: ignore[attr-defined]
            whole = OnDevice(self._whole(), self.device)
            self.objective.prepare(self.trainable, whole, measured)
            if len(loader) > 1:
                self.objective.require_one_batch(self.trainable)
        if self.broken_off:
            self._go_on()
        elif self.solver is None:
            self.trainer.should_stop = True
        elif self.solver.full_batch and len(loader) > 1:
            raise ValueError(
                f"the solver needs all windows in one batch, there are {len(loader)} batches; "
                "set data.batch=null, or choose solver=adam"
            )
        else:
            batches = OnDevice(loader, self.device)
            if len(self.objective.stages) > 1:
                self._compare_end()  # the start, which is better than an end that diverges
            self.objective.begin(self.trainable, batches, self._new_solver, self._note)
            if self.objective.near:
                start = state_of(self.estimator)
                restore(self.estimator, self.objective.near)
                self._compare_end()
                restore(self.estimator, start)
            self._pace(self.solver)
            self.tried = len(self.losses)

    def training_step(self, record: Record, index: int) -> None:
        """Some iterations of the solver on a batch."""
        assert self.solver is not None
        if self.solver.finished:
            self._next_stage()
        present_budget().begin(f"stage {self.objective.stages[self.stage]}")
        problem = self.objective.problem(self.trainable, record, self.stage)
        accepted = self.solver.solve(problem)
        if self.solver.finished and not accepted and not _is_finite(problem):
            self._rescue(record)
        self._note(accepted)
        if self.solver.finished:
            self._stop_after_last_stage()

    def _rescue(self, record: Record) -> None:
        """Begin a stage again whose run is not finite at its start; at most so often.

        Where the plain run of the whole motion is finite, as in steps from noisy states, the stage
        is left out: what comes after it begins there.
        """
        stage, objective = self.objective.stages[self.stage], self.objective
        if self.rescued >= MOST_RESCUES or not objective.kept:
            return
        self.rescued += 1
        told = f"{stage}: the run diverged at its start"
        whole = FreeRunProblem(self.trainable, record, None)
        if self.stage + 1 < len(objective.stages) and _is_finite(whole):
            objective.remarks = [*objective.remarks, f"{told}; it was left out"]
            return
        if self.rescued == 1 and self.chosen[1] and math.isfinite(self.chosen[0]):
            restore(self.estimator, self.chosen[1])
            objective.raised = FIRMER
            way = f"training went back to the best state so far, with the prior times {FIRMER:g}"
        else:
            objective.shorter = max(1, objective.shorter)
            way = "a shorter part was taken first"
        while not _is_finite(objective.problem(self.trainable, record, self.stage)):
            way = "a shorter part was taken first"
            if objective.shorter == MOST_HALVINGS:
                way = "it was left out"
                objective.shorter = 0
                break
            objective.shorter += 1
        else:
            self.solver = self._new_solver(self.free_parameters().values())
        objective.remarks = [*objective.remarks, f"{told}; {way}"]

    def _new_solver(self, parameters: Iterable[nn.Parameter]) -> Solver:
        assert self.make_solver is not None
        return self._pace(self.make_solver(parameters))

    def _pace(self, solver: Solver) -> Solver:
        if self.objective.hurries:
            hurry(solver)
        return solver

    def _note(self, accepted: list[float]) -> None:
        for loss in accepted:
            self.losses.append(loss)
            if self.logger is not None:
                percent = 100.0 * loss**0.5
                values = {"loss": loss, "relative_rms_percent": percent, "stage": self.stage + 1.0}
                named = {f"fit/{name}": value for name, value in values.items()}
                self.logger.log_metrics(named, step=len(self.losses))

    def _stop_after_last_stage(self) -> None:
        """Or where no later stage could take a step."""
        last = self.stage + 1 == len(self.objective.stages) and not self.objective.shorter
        if last or is_out_of_time():
            self.trainer.should_stop = True

    def _next_stage(self) -> None:
        """After the last validation of the stage before, which may have been its best."""
        if self.objective.shorter:  # the same stage, over a longer part
            self._keep_best()
            self.objective.shorter -= 1
        else:
            self._end_stage()
            self.stage, self.rescued = self.stage + 1, 0
            self.objective.enter(self.trainable, self.stage)
            if self.objective.goes_back and self.chosen[1]:
                restore(self.estimator, self.chosen[1])
            if self.objective.refits:
                self.chosen = float("inf"), []
                self._compare_end()
        self.fails, self.best = 0, (float("inf"), {})
        self.solver = self._new_solver(self.free_parameters().values())

    def _end_stage(self) -> None:
        assert self.solver is not None
        self._keep_best()
        before = self.tried + sum(stage["iterations"] for stage in self.ended)
        name, count = self.objective.stages[self.stage], len(self.losses) - before
        self.ended.append({"stage": name, "iterations": count, "stopped": self.solver.why})
        if len(self.objective.stages) > 1:
            self._compare_end()

    def _whole(self) -> Iterable[Record]:
        return self.trainer.datamodule.loader("train")  # type: ignore[attr-defined]

    def _compare_end(self) -> None:
        """Keep the present state if it is the best of the stages' ends.

        It is judged on what the data hold back, where that is some.
        """
        loss = self.objective.final_loss(self.trainable, OnDevice(self._whole(), self.device))
        data = self.trainer.datamodule  # type: ignore[attr-defined]
        if data.validation and math.isfinite(loss):
            held = OnDevice(data.loader(HELD_BACK), self.device)
            error = free_run_score(self.trainable, held)["relative_rms_percent"]
            loss = math.inf if error is None else (0.01 * error) ** 2
        if loss < self.chosen[0]:  # with buffers: each start has units of its own
            self.chosen = loss, state_of(self.estimator)

    @torch.no_grad()
    def _keep_best(self) -> None:
        """The parameters that did best in validation."""
        for name, value in self.best[1].items():
            self.free_parameters()[name].copy_(value)

    def validation_step(self, record: Record, index: int) -> None:
        assert self.solver is not None
        problem = self.objective.problem(self.trainable, record, self.stage)
        self.validated.append(float(problem.loss().detach()))

    def on_validation_epoch_end(self) -> None:
        """Keep the parameters if they are the best so far, over all records held back."""
        assert self.solver is not None
        loss, self.validated = fmean(self.validated), []
        if self.logger is not None:
            percent = {"fit/validation_relative_rms_percent": 100.0 * loss**0.5}
            self.logger.log_metrics(percent, step=len(self.losses))
        self.fails += 1
        if loss < self.best[0]:
            free = self.free_parameters()
            self.best = loss, {name: p.detach().clone() for name, p in free.items()}
            self.fails = 0
        if self.fails >= self.max_fail:
            self.solver.finished, self.solver.why = True, f"{self.fails} validations without gain"
            self._stop_after_last_stage()

    @torch.no_grad()
    def on_fit_end(self) -> None:
        if self.solver is not None:
            self._end_stage()
        if self.chosen[1]:
            restore(self.estimator, self.chosen[1])
        elif len(self.objective.stages) > 1:
            none = "no stage ended in a free run of the training motion that is finite"
            self.objective.remarks = [*self.objective.remarks, none]
        if self.solver is not None:
            loader = self.trainer.datamodule.train_dataloader()  # type: ignore[attr-defined]
            self.objective.refine(self.trainable, OnDevice(loader, self.device), self._note)
        self.fit_seconds = time.perf_counter() - self.start

    def on_test_start(self) -> None:
        self.scores = {}
        self.free_runs = {split: FreeRunScore() for split in SPLITS}
        self.examples = {}

    def test_step(self, record: Record, index: int, dataloader_idx: int = 0) -> None:
        split = (*SPLITS, HELD_BACK)[dataloader_idx]
        estimates = self.scores.setdefault(split, Scores()).update(self.estimator, record)
        if split in self.free_runs:
            self.free_runs[split].update(self.estimator, record)
        if split not in self.examples:
            kept = {way: estimate.cpu() for way, estimate in estimates.items()}
            self.examples[split] = record.to("cpu"), kept

    def results(self) -> dict[str, Any]:
        """Errors in percent of all splits one step ahead, of both motions in free run."""
        one_step = {split: scores.percent() for split, scores in self.scores.items()}
        free = {FREE_RUNS[split]: scores.percent() for split, scores in self.free_runs.items()}
        return {**one_step, **free}

    def estimates_made(self) -> dict[tuple[str, str], Tensor]:
        """Those (…, T, n) of the first batch of each split, by split and way."""
        one_step = {(split, "one step"): own[""] for split, (_, own) in self.examples.items()}
        runs = ((split, score.example) for split, score in self.free_runs.items())
        return one_step | {(split, "free run"): run[1].a for split, run in runs if run is not None}

    @property
    def held_back_error(self) -> float | None:
        """Relative error of the free run on held-back motion; None where none was judged."""
        loss = self.objective.held_back_loss
        return None if loss is None else math.sqrt(loss)

    def how_trained(self) -> dict[str, Any]:
        """How the solver ended; empty where the closed form was all."""
        if self.solver is None:
            return {}
        name, iterations = type(self.solver).__name__, len(self.losses)
        trained: dict[str, Any] = {"solver": name, "iterations": iterations}
        trained |= {"stopped": self.solver.why, **self.objective.facts()}
        return trained if len(self.ended) < 2 else {**trained, "stages": self.ended}


@torch.no_grad()
def _is_finite(problem: Minimised) -> bool:
    return math.isfinite(float(problem.loss()))


class OnDevice(Iterable[Record]):
    """Batches moved to a device, as often as they are iterated."""

    def __init__(self, batches: Iterable[Record], device: torch.device) -> None:
        self.batches, self.device = batches, device

    def __iter__(self) -> Iterator[Record]:
        return (record.to(self.device) for record in self.batches)
