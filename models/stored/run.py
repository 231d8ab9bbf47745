"""The model of a finished run, or of an entry of the zoo, built at the size of its weights."""

from __future__ import annotations

import os
from pathlib import Path

from omegaconf import DictConfig

from data.sample import Sensors
from models.checkpoint import load_estimator, require_built
from models.estimator import Estimator
from models.stored.folder import CHECKPOINT, SENSORS, read_metrics, read_sensors
from models.training.assemble import data_from, estimator_from


def sensors_of(cfg: DictConfig, folder: Path) -> Sensors:
    """What a run's model was built for; runs of earlier layouts need their records for it."""
    path = folder / SENSORS
    if not os.path.lexists(path):
        return data_from(cfg).sensors
    try:
        return Sensors(**read_sensors(folder))
    except (ValueError, TypeError, OSError) as error:
        raise ValueError(f"{path} is damaged ({error}); repeat the run") from None


def restore(cfg: DictConfig, folder: Path) -> Estimator:
    """The identified estimator of a run, of the size and time step it was identified with.

    Its records are not looked at: they may be gone. Raises ValueError where the file is not the one
    that the run wrote.
    """
    sensors, path = sensors_of(cfg, folder), folder / CHECKPOINT
    require_built(path, cfg.model, sensors)
    try:
        estimator = estimator_from(cfg.model, sensors)
    except (MemoryError, RuntimeError) as error:  # PyTorch's, for sizes that nobody has
        raise ValueError(f"{folder}: its model cannot be built: {_first(error)}") from None
    digest = read_metrics(folder).get("checkpoint")  # runs of older code have none
    load_estimator(estimator, path, cfg.model.name, digest)
    return estimator.eval()


def _first(error: Exception) -> str:
    return (str(error) or "not enough memory").partition("\n")[0]
