"""The one LightningModule: fits and scores any estimator.

First the closed form, then a solver for whatever parameters are left. An estimator that has none
left stops there; nothing here asks which estimator it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn

from data.record import Record
from models.estimator import Estimator
from models.training.metrics import Scores
from models.training.problem import Problem
from models.training.solvers.solver import Solver

SPLITS = ("train", "test")  # order of the datamodule's test loaders


class Identification(LightningModule):
    """`solver` makes a solver from the parameters that the closed form leaves free.

    Where the datamodule holds back a part of the training motion for validation, training stops
    after `max_fail` checks without a better one, and the best parameters are kept. A check follows
    each call of the solver: an iteration of Levenberg–Marquardt, some twenty of L-BFGS, an epoch
    of Adam.
    """

    def __init__(
        self,
        estimator: Estimator,
        solver: Callable[[Iterable[nn.Parameter]], Solver] | None = None,
        max_fail: int = 6,
    ) -> None:
        super().__init__()
        if max_fail < 1:
            raise ValueError(f"max_fail={max_fail} must be at least 1")
        self.automatic_optimization = False
        self.estimator, self.make_solver, self.max_fail = estimator, solver, max_fail
        self.solver: Solver | None = None
        self.losses: list[float] = []  # Eq. 21 squared, after every accepted iteration
        self.solution: dict[str, float] = {}  # what the closed form says of itself
        self.fit_seconds = 0.0
        self.best: tuple[float, dict[str, Tensor]] = (float("inf"), {})
        self.fails = 0
        self.scores: dict[str, Scores] = {}
        self.examples: dict[str, tuple[Record, dict[str, Tensor]]] = {}  # first batch, estimates

    def free_parameters(self) -> dict[str, nn.Parameter]:
        return {name: p for name, p in self.estimator.named_parameters() if p.requires_grad}

    def configure_optimizers(self) -> list[Any]:
        if not self.free_parameters():
            return []
        if self.make_solver is None:
            raise ValueError(
                f"{type(self.estimator).__name__} has free parameters; choose a solver"
            )
        self.solver = self.make_solver(self.free_parameters().values())
        return [self.solver]

    def on_fit_start(self) -> None:
        self.start = time.perf_counter()
        loader = self.trainer.datamodule.train_dataloader()  # type: ignore[attr-defined]
        self.solution = self.estimator.identify(OnDevice(loader, self.device))
        if self.solver is None:
            self.trainer.should_stop = True
        elif self.solver.full_batch and len(loader) > 1:
            raise ValueError(
                f"the solver needs all windows in one batch, there are {len(loader)} batches; "
                "set data.batch=null, or choose solver=adam"
            )

    def training_step(self, record: Record, index: int) -> None:
        """Some iterations of the solver on a batch."""
        assert self.solver is not None
        for loss in self.solver.solve(Problem(self.estimator, record)):
            self.losses.append(loss)
            if self.logger is not None:
                values = {"fit/loss": loss, "fit/relative_rms_percent": 100.0 * loss**0.5}
                self.logger.log_metrics(values, step=len(self.losses))
        if self.losses:
            self.log("error_percent", 100.0 * self.losses[-1] ** 0.5, prog_bar=True, logger=False)
        if self.solver.finished:
            self.trainer.should_stop = True

    def validation_step(self, record: Record, index: int) -> None:
        assert self.solver is not None
        loss = float(Problem(self.estimator, record).loss().detach())
        if self.logger is not None:
            percent = {"validation/relative_rms_percent": 100.0 * loss**0.5}
            self.logger.log_metrics(percent, step=len(self.losses))
        self.fails += 1
        if loss < self.best[0]:
            free = self.free_parameters()
            self.best = loss, {name: p.detach().clone() for name, p in free.items()}
            self.fails = 0
        if self.fails >= self.max_fail:
            self.solver.finished, self.solver.why = True, f"{self.fails} validations without gain"
            self.trainer.should_stop = True

    @torch.no_grad()
    def on_fit_end(self) -> None:
        for name, value in self.best[1].items():
            self.free_parameters()[name].copy_(value)
        self.fit_seconds = time.perf_counter() - self.start

    def on_test_start(self) -> None:
        self.scores = {split: Scores() for split in SPLITS}
        self.examples = {}

    def test_step(self, record: Record, index: int, dataloader_idx: int = 0) -> None:
        split = SPLITS[dataloader_idx]
        estimates = self.scores[split].update(self.estimator, record)
        self.examples.setdefault(split, (record, estimates))

    def results(self) -> dict[str, Any]:
        """Errors in percent of both splits."""
        return {split: scores.percent() for split, scores in self.scores.items()}

    def how_trained(self) -> dict[str, Any]:
        """How the solver ended; empty where the closed form was all."""
        if self.solver is None:
            return {}
        name, iterations = type(self.solver).__name__, len(self.losses)
        return {"solver": name, "iterations": iterations, "stopped": self.solver.why}


class OnDevice(Iterable[Record]):
    """Batches moved to a device, as often as they are iterated."""

    def __init__(self, batches: Iterable[Record], device: torch.device) -> None:
        self.batches, self.device = batches, device

    def __iter__(self) -> Iterator[Record]:
        return (record.to(self.device) for record in self.batches)
