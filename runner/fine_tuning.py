"""Training that begins at the weights of a finished run: `start=FOLDER`, `start=zoo:MODEL/SYSTEM`.

For a new record of the same structure, or of one that has changed a little: fewer records and fewer
seconds than from nothing. Nothing is identified in closed form and no start is drawn; what the new
record leaves open stays what it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from models.checkpoint import load_estimator
from models.training.assemble import changed
from models.training.identification import Identification
from models.zoo import index as zoo
from runner.folder.run_files import CHECKPOINT, run_folder
from runner.folder.run_folder import read_run

LATER = (
    2  # stages of a free run that are left: from weights that nearly fit, short parts tell little
)


def prepared(cfg: DictConfig) -> DictConfig:
    """The config of training from `cfg.start`: one start, later horizons; a version is pinned.

    The same config where no start is asked for. Raises ValueError for a start that is not there, or
    is of another model.
    """
    if not cfg.get("start"):
        return cfg
    word, folder = cfg.start, run_folder(cfg.start)
    if zoo.is_name(word):
        word = zoo.PREFIX + zoo.entry_of(word).name
    own, _ = read_run(folder)
    if own.model.name != cfg.model.name:
        raise ValueError(
            f"start={cfg.start} holds {own.model.name}, and model={cfg.model.name} is trained; "
            f"say model={own.model.name}"
        )
    changes: dict[str, Any] = {"start": word}
    if "horizons" in cfg.objective:
        horizons = list(cfg.objective.horizons)[-LATER:]
        changes["objective"] = {"starts": 1, "finalists": 1, "select": [], "horizons": horizons}
    return changed(cfg, changes)


def begin_at_start(module: Identification, cfg: DictConfig) -> None:
    """Give the estimator the weights of `cfg.start`, if there is one.

    Raises ValueError for a model that no solver trains, and for weights that do not fit the data.
    """
    if not cfg.get("start"):
        return
    if not module.free_parameters():
        raise ValueError(
            f"start={cfg.start}: model={cfg.model.name} is solved in closed form, from nothing as "
            "fast as from weights; leave start= out"
        )
    folder = run_folder(cfg.start)
    _, metrics = read_run(folder)
    checkpoint = Path(folder) / CHECKPOINT
    load_estimator(module.estimator, checkpoint, cfg.model.name, metrics.get("checkpoint"))
    module.begun_at = str(cfg.start)
