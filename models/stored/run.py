"""A finished run, or an entry of the zoo, as objects: its choices, its numbers, its model."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from data.sample import Sensors
from models.checkpoint import load_estimator, require_built
from models.estimator import Estimator
from models.experiment import Experiment
from models.stored.folder import CHECKPOINT, SENSORS, read_sensors, read_values_of_run


@dataclass(frozen=True)
class StoredRun:
    """What is read back of a run. values: all of its choices, resolved; metrics: `metrics.json`."""

    folder: Path
    values: Mapping[str, Any]
    metrics: dict[str, Any]
    experiment: Experiment

    @cached_property
    def sensors(self) -> Sensors:
        """What the model was built for; runs of earlier layouts need their records for it."""
        path = self.folder / SENSORS
        if not os.path.lexists(path):
            return self.experiment.make_data().sensors
        try:
            return Sensors(**read_sensors(self.folder))
        except (ValueError, TypeError, OSError) as error:
            raise ValueError(f"{path} is damaged ({error}); repeat the run") from None

    def restore(self) -> Estimator:
        """The identified estimator, of the size and time step that it was identified with.

        Its records are not looked at: they may be gone. Raises ValueError where the file is not the
        one that the run wrote.
        """
        path, model = self.folder / CHECKPOINT, self.experiment.model
        require_built(path, model.values, self.sensors)
        try:
            estimator = model.estimator(self.sensors)
        except (MemoryError, RuntimeError) as error:  # PyTorch's, for sizes that nobody has
            raise ValueError(f"{self.folder}: its model cannot be built: {_first(error)}") from None
        digest = self.metrics.get("checkpoint")  # runs of older code have none
        load_estimator(estimator, path, model.name, digest)
        return estimator.eval()


def read_run(folder: Path) -> StoredRun:
    """A finished run. Raises ValueError for a folder that holds none, and for damaged files."""
    values, metrics = read_values_of_run(folder)
    return StoredRun(folder, values, metrics, Experiment.of(values))


def _first(error: Exception) -> str:
    return (str(error) or "not enough memory").partition("\n")[0]
