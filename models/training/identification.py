"""The one LightningModule: fits and scores any estimator.

First the closed form, then gradient training of whatever parameters are left. An estimator that has
none left stops there; nothing here asks which estimator it is.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import torch
from lightning.pytorch import LightningModule
from torch import Tensor, nn
from torch.optim import Optimizer

from data.record import Record
from models.estimator import Estimator
from models.training.metrics import Score

SPLITS = ("train", "test")  # order of the datamodule's test loaders


class Identification(LightningModule):
    """`solver` makes an optimizer from the parameters that the closed form leaves free."""

    def __init__(
        self,
        estimator: Estimator,
        solver: Callable[[Iterable[nn.Parameter]], Optimizer] | None = None,
    ) -> None:
        super().__init__()
        self.estimator, self.solver = estimator, solver
        self.solution: dict[str, float] = {}  # what the closed form says of itself
        self.fit_seconds = 0.0
        self.scores: dict[str, Score] = {}
        self.examples: dict[str, tuple[Record, Tensor]] = {}  # first batch of a split, its estimate

    def free_parameters(self) -> list[nn.Parameter]:
        return [p for p in self.estimator.parameters() if p.requires_grad]

    def configure_optimizers(self) -> list[Optimizer]:
        if not self.free_parameters():
            return []
        if self.solver is None:
            raise ValueError(
                f"{type(self.estimator).__name__} has free parameters; choose a solver"
            )
        return [self.solver(self.free_parameters())]

    def on_fit_start(self) -> None:
        self.start = time.perf_counter()
        loader = self.trainer.datamodule.train_dataloader()  # type: ignore[attr-defined]
        self.solution = self.estimator.identify(OnDevice(loader, self.device))
        if not self.free_parameters():
            self.trainer.should_stop = True

    def training_step(self, record: Record, index: int) -> Tensor:
        """Squared error relative to the measured acceleration, over the counted samples."""
        counted = slice(record.warmup, None)
        measured = record.a[..., counted, :]
        error = self.estimator(record.measured())[..., counted, :] - measured
        loss = (error**2).sum() / (measured**2).sum()
        batch = record.a.shape[0]
        self.log("loss", loss, on_step=True, on_epoch=False, prog_bar=True, batch_size=batch)
        return loss

    def on_fit_end(self) -> None:
        self.fit_seconds = time.perf_counter() - self.start

    def on_test_start(self) -> None:
        self.scores = {split: Score() for split in SPLITS}
        self.examples = {}

    def test_step(self, record: Record, index: int, dataloader_idx: int = 0) -> None:
        split = SPLITS[dataloader_idx]
        estimate = self.scores[split].update(self.estimator, record)
        self.examples.setdefault(split, (record, estimate))

    def results(self) -> dict[str, Any]:
        """Errors in percent of both splits."""
        return {split: score.percent() for split, score in self.scores.items()}


class OnDevice(Iterable[Record]):
    """Batches moved to a device, as often as they are iterated."""

    def __init__(self, batches: Iterable[Record], device: torch.device) -> None:
        self.batches, self.device = batches, device

    def __iter__(self) -> Iterator[Record]:
        return (record.to(self.device) for record in self.batches)
