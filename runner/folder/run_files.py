"""Names of the files of a run's folder, and whether a finished one is there."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hydra.utils import to_absolute_path

from models.stored.folder import CHECKPOINT as CHECKPOINT
from models.stored.folder import CONFIG as CONFIG
from models.stored.folder import METRICS as METRICS
from models.stored.folder import SENSORS as SENSORS
from models.stored.folder import require_finished as require_finished
from models.zoo import index as zoo

EVENTS = "events.out.tfevents.*"  # TensorBoard's
EARLIER = "metrics.earlier.json"  # of another results version, until a sweep has repeated the run
FAILED = "failed.json"  # why a run of a sweep has no metrics.json
PROGRESS = "training.ckpt"
FREE_RUN = "free_run"  # of the test motion, in metrics.json


def run_folder(word: str) -> Path:
    """The folder of a finished run as typed, or of a published model: zoo:MODEL/SYSTEM.

    Raises ValueError for a name that is not published, and where a published file was changed.
    """
    return zoo.folder_of(word) if zoo.is_name(word) else Path(word)


def results_folder(folder: Path) -> Path:
    """Folder for results made of a run: its own; of a published model, in runs/zoo/."""
    name = zoo.published(folder)
    return folder if name is None else Path(to_absolute_path("runs")) / "zoo" / name


def require_folders(names: str | Sequence[str] | None) -> None:
    """Raise ValueError for a folder of runs that is not there; patterns are looked at later."""
    for name in [names] if isinstance(names, str) else names or []:
        if not set(name) & set("*?[") and not Path(to_absolute_path(name)).is_dir():
            raise ValueError(
                f"there is no folder {name}; runs= takes a folder, a list [a,b] or a pattern"
            )
