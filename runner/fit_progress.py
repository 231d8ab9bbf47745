"""One line on a fit while it lasts: what it is about, error, seconds; nothing is left of it.

Where the output is no terminal a plain line follows now and then.
"""

from __future__ import annotations

import shutil
import sys
import threading
import time
from contextlib import ExitStack
from typing import Any

from lightning.pytorch import Callback, LightningModule, Trainer

from models.training.doing import heard
from models.training.identification import Identification

EVERY, EVERY_PLAIN = 0.2, 30.0  # seconds between lines, in a terminal and elsewhere


class FitProgress(Callback):
    """Shows how far the fit of an `Identification` is, on the stream of messages."""

    def __init__(self) -> None:
        self.told = self.begun = time.monotonic()
        self.stage = 0
        self.shown = False
        self.listening = ExitStack()
        self.lock = threading.Lock()  # laws of several elements are identified side by side

    def on_fit_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.begun = time.monotonic()
        self.listening.enter_context(heard(self._identifying))

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self.begun = time.monotonic()

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, *rest: Any, **more: Any
    ) -> None:
        assert isinstance(pl_module, Identification)
        if pl_module.stage != self.stage:
            self.stage, self.begun = pl_module.stage, time.monotonic()
        self._tell(lambda: line_of(pl_module, time.monotonic() - self.begun))

    def on_fit_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        self._clear()

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        self._clear()

    def _identifying(self, what: str) -> None:
        self._tell(lambda: f"identifying: {what}, {time.monotonic() - self.begun:.0f} s")

    def _tell(self, line: Any) -> None:
        terminal, now = sys.stderr.isatty(), time.monotonic()
        with self.lock:
            if now - self.told < (EVERY if terminal else EVERY_PLAIN):
                return
            self.told = now
            if terminal:
                width = shutil.get_terminal_size().columns - 1
                sys.stderr.write(f"\r\x1b[K{line()[:width]}")
                self.shown = True
            else:
                sys.stderr.write(f"{line()}\n")
            sys.stderr.flush()

    def _clear(self) -> None:
        self.listening.close()
        if self.shown:
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()
            self.shown = False


def line_of(module: Identification, seconds: float) -> str:
    """Stage, iterations, error [%], seconds of a fit and how many its stage may take yet.

    seconds: since the stage began.
    """
    stages, solver = module.objective.stages, module.solver
    stage = f"stage {module.stage + 1} of {len(stages)} ({stages[module.stage]}), "
    error = f", error {100.0 * module.losses[-1] ** 0.5:.4g} %" if module.losses else ""
    left = ""
    if solver is not None and solver.done:
        more = seconds / solver.done * (solver.iterations - solver.done)
        left = f", at most {more:.0f} s left" + (" in it" if len(stages) > 1 else "")
    where = stage if len(stages) > 1 else ""
    spent = time.perf_counter() - module.start
    return f"{where}iteration {len(module.losses)}{error}, {spent:.0f} s{left}"
