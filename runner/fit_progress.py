"""One line on a fit while it lasts: stage, iterations, error and seconds; nothing is left of it.

Where the output is no terminal a plain line follows now and then.
"""

from __future__ import annotations

import shutil
import sys
import time
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer

from models.training.identification import Identification

EVERY, EVERY_PLAIN = 0.2, 30.0  # seconds between lines, in a terminal and elsewhere


class FitProgress(Callback):
    """Shows how far the fit of an `Identification` is, on the stream of messages."""

    def __init__(self) -> None:
        self.told = time.monotonic()
        self.shown = False

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, *rest: Any, **more: Any
    ) -> None:
        assert isinstance(pl_module, Identification)
        terminal, now = sys.stderr.isatty(), time.monotonic()
        if now - self.told < (EVERY if terminal else EVERY_PLAIN):
            return
        self.told = now
        line = line_of(pl_module)
        if terminal:
            width = shutil.get_terminal_size().columns - 1
            sys.stderr.write(f"\r\x1b[K{line[:width]}")
            self.shown = True
        else:
            sys.stderr.write(f"{line}\n")
        sys.stderr.flush()

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._clear()

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        self._clear()

    def _clear(self) -> None:
        if self.shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self.shown = False


def line_of(module: Identification) -> str:
    """Stage, iterations, error [%] and seconds of a fit under way."""
    stages = module.objective.stages
    stage = f"stage {module.stage + 1} of {len(stages)} ({stages[module.stage]}), "
    error = f", error {100.0 * module.losses[-1] ** 0.5:.4g} %" if module.losses else ""
    seconds = time.perf_counter() - module.start
    where = stage if len(stages) > 1 else ""
    return f"{where}iteration {len(module.losses)}{error}, {seconds:.0f} s"
