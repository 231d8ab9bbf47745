"""Half-done training on disk: saved at intervals, continued by the same run.

One file, written aside and renamed: what Lightning saves, then a digest of it. Nothing is unpickled
unless the digest holds, and then only tensors and plain values, by a run of the same config and
code: training ends where it would have ended.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule, Trainer

from data.whole_file import open_regular, whole_file

MARK = b"\nsha256 "  # before the digest, at the end of the file
TAIL = len(MARK) + 64


class SaveProgress(Callback):
    """Saves after an epoch (a call of a full-batch solver), where `seconds` went by since the last.

    identity: of the run; the file holds it. Weights that are not numbers any more are not saved.
    """

    def __init__(self, path: Path, identity: Mapping[str, Any], seconds: float) -> None:
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
        if not has_nan(pl_module.state_dict()):
            with whole_file(self.path) as aside:
                trainer.save_checkpoint(aside)
                seal(aside)
        self.saved = time.monotonic()


def seal(path: Path) -> None:
    """Write the digest of a file at its end."""
    with path.open("r+b") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
        file.write(MARK + digest.encode())


def has_nan(state: Mapping[str, Any]) -> bool:
    """Whether a weight is not a number. Raises AttributeError for what is no tensor."""
    return any(bool(value.isnan().any()) for value in state.values())


def fault_of(path: Path, identity: Mapping[str, Any]) -> str:
    """Why a file is not the half-done training of this run, in words; "" where it is."""
    try:
        if not _sealed(path):
            return "is damaged, or of earlier code"
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
        if checkpoint["identity"] != dict(identity):
            return "is of other choices or another results version"
        return "holds weights that are not numbers" if has_nan(checkpoint["state_dict"]) else ""
    except FileNotFoundError:
        return "is not there"
    except (  # whatever torch.load finds in a file that somebody else wrote and sealed
        OSError, RuntimeError, ValueError, EOFError, KeyError, TypeError, AttributeError,
        IndexError, pickle.UnpicklingError,
    ):  # fmt: skip
        return "is damaged"


def _sealed(path: Path) -> bool:
    """Whether a file ends in the digest of what stands before it."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size - TAIL
        if size < 0:
            return False
        file.seek(size)
        tail = file.read()
        if not tail.startswith(MARK):  # before the rest is read: the file may have any size
            return False
        file.seek(0)
        digest, left = hashlib.sha256(), size
        while part := file.read(min(left, 2**20)):
            digest.update(part)
            left -= len(part)
    return left == 0 and tail == MARK + digest.hexdigest().encode()
