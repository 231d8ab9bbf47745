"""A run's TensorBoard logs, in the folder of the run itself: that is its name there."""

from __future__ import annotations

from pathlib import Path

from lightning.pytorch.loggers import TensorBoardLogger


class RunLogger(TensorBoardLogger):
    """Lightning's, without its file of choices: the run has config.yaml."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, name="", version="")

    def save(self) -> None:
        self.experiment.flush()
