"""Half-done training on disk: saved at intervals, continued by the same run.

One file, written aside and renamed. Only tensors and plain values are read back from it, and only
by a run of the same config and code: training then ends where it would have ended.
"""

from __future__ import annotations

import os
import pickle
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer


class SaveProgress(Callback):
    """Saves after an epoch (a call of a full-batch solver), where `seconds` went by since the last.

    identity: of the run; the file holds it.
    """

    def __init__(self, path: Path, identity: Mapping[str, str], seconds: float) -> None:
        if not seconds >= 0.0:
            raise ValueError(f"checkpoint_seconds={seconds} must not be negative; .inf saves none")
        self.path, self.identity, self.seconds = path, dict(identity), seconds
        self.saved = time.monotonic()

    def on_save_checkpoint(
        self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        checkpoint["identity"] = self.identity

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        if trainer.should_stop or time.monotonic() - self.saved < self.seconds:
            return
        aside = self.path.with_suffix(".part")
        trainer.save_checkpoint(aside)
        os.replace(aside, self.path)
        self.saved = time.monotonic()


def belongs(path: Path, identity: Mapping[str, str]) -> bool:
    """Whether a file holds the half-done training of this run. A damaged one does not."""
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, KeyError, pickle.UnpicklingError):
        return False
    return isinstance(checkpoint, dict) and checkpoint.get("identity") == dict(identity)
