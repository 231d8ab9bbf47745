"""A run's folder: what is written, in which order, and how it is read back.

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
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from data.arguments import reason
from runner.config.identity import RESULTS, front_name
from runner.config.plain_data import as_config, read_json, read_text, read_yaml
from runner.config.schema import CONFIG_KIND, FAILURE_KIND, METRICS_KIND, SENSORS_KIND, require
from runner.config.settings import TRAIN
from runner.folder.lock import hold
from runner.folder.run_files import CONFIG, FAILED, METRICS, SENSORS, require_finished

NEEDED = ("system", "scenario", "model", "data", "excitation", "seed", "threads")  # of a config


def settings_of(choice: Mapping[str, Any]) -> dict[str, Any]:
    """A choice's resolved values without its name."""
    return {key: value for key, value in choice.items() if key not in ("name", "_target_")}


def config_text(cfg: DictConfig) -> str:
    """The content of config.yaml."""
    return OmegaConf.to_yaml(cfg, resolve=True)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    aside = path.with_name(path.name + ".part")
    aside.write_text(text, encoding="utf-8")
    os.replace(aside, path)


def write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def write_failure(
    folder: Path,
    cfg: DictConfig | None,
    reason: str,
    trace: str,
    own: bool,
    escaped: bool = False,
) -> None:
    """Why a run of a sweep has no numbers.

    own: it would fail again, wherever it is run; escaped: the structure's own motion left every
    bound, so no estimator ran. Raises ValueError where another process works in the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    hold(folder)
    if cfg is not None:
        write_text(folder / CONFIG, config_text(cfg))
    content = {"reason": reason, "own": own, "escaped": escaped, "results": RESULTS}
    write_json(folder / FAILED, content | {"trace": trace})


def read_failure(folder: Path) -> dict[str, Any]:
    """What `write_failure` wrote. Raises ValueError where the file holds something else.

    In older runs the reason alone tells that a motion escaped.
    """
    failure: dict[str, Any] = _read(folder / FAILED, FAILURE_KIND)
    if "reason" not in failure:
        raise ValueError(f"{FAILED} has no reason")
    return {
        "escaped": "motion escaped at t =" in failure["reason"],
        **{"own": False, "results": None},
        **failure,
    }


def read_metrics(folder: Path) -> dict[str, Any]:
    """Numbers of a finished run. Raises ValueError where the file holds none."""
    return _read(folder / METRICS, METRICS_KIND)


def read_sensors(folder: Path) -> dict[str, Any]:
    """What a run's model was built for. Raises ValueError where the file holds something else."""
    return _read(folder / SENSORS, SENSORS_KIND)


def _read(path: Path, kind: Any) -> dict[str, Any]:
    """Content of a JSON file, of the types in runner/config/schema.py."""
    content = read_json(path)
    try:
        require(content, kind)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None
    plain_data: dict[str, Any] = content
    return plain_data


def read_run(folder: Path) -> tuple[DictConfig, dict[str, Any]]:
    """Config and metrics of a finished run. Raises ValueError where there is none.

    The config is plain data: what looks like an interpolation in it is text, and the run's records
    are never downloaded. Configs of earlier layouts, which name classes by their modules, are read
    as today's.
    """
    require_finished(folder)
    try:
        cfg = as_config(_by_front(read_config(folder)))
        metrics = read_metrics(folder)
    except (ValueError, OSError) as error:
        raise ValueError(f"{folder} is damaged: {reason(error)}; repeat the run") from None
    if "download" in cfg.data:
        cfg.data.download = False
    return cfg, metrics


def read_config(folder: Path) -> dict[str, Any]:
    """Resolved values of a run. Raises ValueError for what is no config of one."""
    try:
        content: dict[str, Any] = read_yaml(read_text(folder / CONFIG))
        require(content, CONFIG_KIND)
        if missing := [key for key in NEEDED if key not in content]:
            raise ValueError(f"it lacks {', '.join(missing)}")
        for key in ("seed", "threads"):
            TRAIN[key].check(key, content[key])
    except ValueError as error:
        raise ValueError(f"{CONFIG}: {error}") from None
    return content


def _by_front(node: Any) -> Any:
    """The same with every `_target_` as the fronts name it."""
    if isinstance(node, list):
        return [_by_front(value) for value in node]
    if isinstance(node, dict):
        plain_ones = {key: _by_front(value) for key, value in node.items()}
        if isinstance(node.get("_target_"), str):
            plain_ones["_target_"] = front_name(node["_target_"])
        return plain_ones
    return node
