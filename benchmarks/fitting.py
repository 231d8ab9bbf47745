"""A model fitted to records as train.py fits it, and its error in free run."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from functools import cache
from typing import Any

import torch
from lightning.pytorch import Trainer

from data import Record
from data.datamodule import Data
from models import Estimator
from models.experiment import Experiment
from runner.config.choices import plain
from runner.config.compose import composed
from runner.job import quiet_lightning


class Given(Data):
    """Records at hand, all to train on."""

    name = "given"

    def __init__(self, records: Sequence[Record]) -> None:
        super().__init__()
        self.given, self.dt = list(records), records[0].dt
        self.dofs, self.inputs = records[0].dofs, records[0].excitation.shape[-1]
        self.setup()

    def make_records(self) -> dict[str, list[Record]]:
        return {"train": self.given}


@quiet_lightning()
def fit(words: Sequence[str], records: Sequence[Record]) -> tuple[Estimator, dict[str, Any]]:
    """The model of a command line, fitted to records; and what its identification reports."""
    data = Given(records)
    module = _experiment(tuple(words)).make_identification(data)
    with tempfile.TemporaryDirectory() as folder:
        Trainer(
            accelerator="cpu", devices=1, max_epochs=-1, logger=False, limit_val_batches=0,
            enable_checkpointing=False, enable_model_summary=False, enable_progress_bar=False,
            default_root_dir=folder,
        ).fit(module, datamodule=data)  # fmt: skip
    return module.estimator, module.solution


@cache
def _experiment(words: tuple[str, ...]) -> Experiment:
    return Experiment.of(plain(composed(*words)))


@torch.no_grad()
def free_run_error(model: Estimator, records: Sequence[Record]) -> float:
    """Relative RMS error of free runs over all records [%]; not finite where one diverged."""
    errors = sum(float(((model.free_run(r.drive()).a - r.a) ** 2).sum()) for r in records)
    return 100.0 * (errors / sum(float((r.a**2).sum()) for r in records)) ** 0.5
