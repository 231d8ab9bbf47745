"""A run's folder: its files, in which order they are written; models/stored/folder.py reads them.

config.yaml        every choice, resolved; with the code, all that is needed to repeat the run
sensors.json       time step, DOFs and channels: what a model is rebuilt for, without its records
model.safetensors  the identified estimator
tensorboard/       scalars and figures
metrics.json       the numbers; written last, so a run that has it is finished
training.ckpt      half-done training, to go on from; gone once the run is finished
failed.json        in a sweep: why there are no numbers
.lock              who works here, while somebody does (runner/folder/lock.py)
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml
from hydra.utils import to_absolute_path
from omegaconf._utils import get_omega_conf_dumper

from data.whole_file import write_text
from models.stored.folder import CHECKPOINT as CHECKPOINT
from models.stored.folder import CONFIG as CONFIG
from models.stored.folder import METRICS as METRICS
from models.stored.folder import SENSORS as SENSORS
from models.stored.folder import read_metrics as read_metrics
from models.stored.folder import read_values
from models.stored.folder import require_finished as require_finished
from models.stored.schema import FAILURE_KIND
from models.zoo import index as zoo
from runner.config.identity import RESULTS, config_digest
from runner.folder.lock import hold

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


def settings_of(choice: Mapping[str, Any]) -> dict[str, Any]:
    """A choice's resolved values without its name."""
    return {key: value for key, value in choice.items() if key not in ("name", "_target_")}


def config_text(values: Mapping[str, Any]) -> str:
    """The content of config.yaml, as OmegaConf writes it: texts stay texts when they are read."""
    own = get_omega_conf_dumper()
    fast = getattr(yaml, "CDumper", yaml.Dumper)  # writes the same four times as fast
    parts = {name: getattr(own, name) for name in ("yaml_representers", "yaml_implicit_resolvers")}
    return yaml.dump(
        values,
        Dumper=type("Dumper", (fast,), parts),
        default_flow_style=False,
        allow_unicode=True,
        sort_keys=False,
    )


def write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_failure(
    folder: Path,
    values: Mapping[str, Any] | None,
    reason: str,
    trace: str,
    own: bool,
    escaped: bool = False,
) -> None:
    """Why a run of a sweep has no numbers.

    values: its choices, where they are known; own: it would fail again, wherever it is run;
    escaped: the structure's own motion left every bound, so no estimator ran. Raises ValueError
    where another process works in the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    hold(folder)
    content = {"reason": reason, "own": own, "escaped": escaped, "results": RESULTS}
    if values is not None:
        write_text(folder / CONFIG, config_text(values))
        content["config"] = config_digest(dict(values))
    write_json(folder / FAILED, content | {"trace": trace})


def read_failure(folder: Path) -> dict[str, Any]:
    """What `write_failure` wrote. Raises ValueError where the file holds something else.

    In older runs the reason alone tells that a motion escaped.
    """
    failure: dict[str, Any] = read_values(folder / FAILED, FAILURE_KIND)
    return {
        "escaped": "motion escaped at t =" in failure["reason"],
        **{"own": False, "results": None},
        **failure,
    }
