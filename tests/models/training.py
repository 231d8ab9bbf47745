"""Fits as train.py makes them, without logs, bars and checkpoints."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from lightning.pytorch import Callback, Trainer

from data.datamodule import Data
from models.fit.identification import Identification


def trainer(folder: Path, data: Data, callbacks: Iterable[Callback] = ()) -> Trainer:
    """A quiet trainer, which goes on until the solver has finished."""
    return Trainer(
        accelerator="cpu", devices=1, max_epochs=-1, callbacks=list(callbacks), logger=False,
        num_sanity_val_steps=0, enable_progress_bar=False, enable_model_summary=False,
        enable_checkpointing=False, limit_val_batches=None if data.validation else 0,
        log_every_n_steps=1, default_root_dir=folder,
    )  # fmt: skip


def fit(module: Identification, data: Data, folder: Path) -> Identification:
    trainer(folder, data).fit(module, datamodule=data)
    return module
