"""A run's TensorBoard logs, in the folder of the run itself: that is its name there."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import TensorBoardLogger
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData
from torch.utils.tensorboard.summary import hparams


class RunLogger(TensorBoardLogger):
    """Lightning's, without its file of choices: the run has config.yaml."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, name="", version="")

    def log_choices(
        self, choices: Mapping[str, Any], numbers: Mapping[str, float], first: tuple[str, ...]
    ) -> None:
        """Choices and numbers of HParams, whose columns are those of `first`, then by name.

        TensorBoard sorts columns by name; those that are said to differ between runs are before.
        """
        board, parts = self.experiment._get_file_writer(), hparams(dict(choices), dict(numbers))
        said = parts[0].value[0].metadata.plugin_data
        content = HParamsPluginData.FromString(said.content)
        for info in content.experiment.hparam_infos:
            info.differs = info.name in first
        said.content = content.SerializeToString()
        for part in parts:
            board.add_summary(part)
        self.log_metrics(dict(numbers))

    def save(self) -> None:
        self.experiment.flush()
