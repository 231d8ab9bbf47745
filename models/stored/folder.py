"""Files of a finished run, or of an entry of the zoo, read back as plain data.

Nothing is resolved, built or fetched because a file says so; what is read has the types, sizes and
keys of models/stored/schema.py.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from data.arguments import reason
from data.plain_data import read_json, read_text, read_yaml, require_given
from models.stored.earlier_keys import ONLY_WAY, todays_keys
from models.stored.schema import CONFIG_KIND, METRICS_KIND, SENSORS_KIND, front_name, require

CONFIG, CHECKPOINT, METRICS = "config.yaml", "model.safetensors", "metrics.json"
SENSORS = "sensors.json"


def require_finished(folder: Path) -> None:
    """Raise ValueError for a folder that holds no finished run."""
    if not folder.is_dir():
        raise ValueError(
            f"{folder} is not a finished run: there is no such folder; give the one that train.py "
            "wrote (hydra.run.dir)"
        )
    if not os.path.lexists(folder / METRICS) and (inside := _runs_in(folder)):
        raise ValueError(
            f"{folder} is not a finished run, it holds {len(inside)}; give one of them, such as "
            f"{inside[0]}"
        )
    for name in (CONFIG, CHECKPOINT, METRICS):
        if not os.path.lexists(folder / name):
            raise ValueError(
                f"{folder} is not a finished run: it has no {name}; "
                "give the folder that train.py wrote (hydra.run.dir)"
            )


def _runs_in(folder: Path) -> list[Path]:
    """Finished runs in a folder, as of a sweep, or in its folders, as of a day's."""
    return sorted(p.parent for depth in ("*", "*/*") for p in folder.glob(f"{depth}/{METRICS}"))


def read_values_of_run(folder: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Choices and metrics of a finished run. Raises ValueError where there is none.

    The choices are plain data: what looks like an interpolation in them is text, and the run's
    records are never downloaded. Configs of earlier layouts, which name classes by their modules,
    are read as today's.
    """
    require_finished(folder)
    try:
        choices = _by_front(read_config(folder))
        require_given(choices)
        metrics = read_metrics(folder)
    except (ValueError, OSError) as error:
        raise ValueError(f"{folder} is damaged: {reason(error)}; repeat the run") from None
    if "download" in choices["data"]:
        choices["data"]["download"] = False
    return choices, metrics


def read_config(folder: Path) -> dict[str, Any]:
    """Resolved values of a run. Raises ValueError for what is no config of one."""
    try:
        content: dict[str, Any] = read_yaml(read_text(folder / CONFIG))
        require(content, CONFIG_KIND)
    except ValueError as error:
        raise ValueError(f"{CONFIG}: {error}") from None
    return content


def read_metrics(folder: Path) -> dict[str, Any]:
    """Numbers of a finished run, as far as it has any. Raises ValueError where the file is none."""
    return read_values(folder / METRICS, METRICS_KIND)


def read_sensors(folder: Path) -> dict[str, Any]:
    """What a run's model was built for. Raises ValueError where the file holds something else."""
    return read_values(folder / SENSORS, SENSORS_KIND)


def read_values(path: Path, kind: Any) -> dict[str, Any]:
    """Content of a JSON file, of the kind of models/stored/schema.py that it has to be of."""
    content = read_json(path)
    content = todays_keys(content) if kind is METRICS_KIND else content
    try:
        require(content, kind)
    except ValueError as error:
        raise ValueError(f"{path.name}: {error}") from None
    return content


def _by_front(node: Any) -> Any:
    """The same with every `_target_` as the fronts name it, without the settings of ONLY_WAY."""
    if isinstance(node, list):
        return [_by_front(value) for value in node]
    if isinstance(node, dict):
        plain_ones = {key: _by_front(value) for key, value in node.items()}
        if isinstance(node.get("_target_"), str):
            plain_ones["_target_"] = front_name(node["_target_"])
            only = ONLY_WAY.get(plain_ones["_target_"], {})
            return {k: v for k, v in plain_ones.items() if k not in only or v != only[k]}
        return plain_ones
    return node
