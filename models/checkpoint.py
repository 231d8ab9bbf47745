"""An identified estimator on disk: its state_dict as safetensors, which cannot hold code."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from data.annotations import shown
from data.checked import built_with
from data.plain_data import PARSER_ERRORS
from data.sample import Sensors
from data.whole_file import digest_of, open_regular, whole_file
from models.estimator import Estimator

HEADER = 2**20  # bytes of names and shapes at most


def save_estimator(estimator: Estimator, path: Path, name: str) -> None:
    """Write `path` whole or not at all; `name` is the model's name in the config.

    Raises OSError where the disk does not take it.
    """
    tensors = {
        key: value.detach().cpu().contiguous() for key, value in estimator.state_dict().items()
    }
    tensors = tensors or {"empty": torch.zeros(0)}  # the format has no empty file
    # one entry: the format writes several in an order of its own, which differs from call to call
    model = json.dumps({"name": name, "built": built_with(estimator)})
    with whole_file(path) as aside:
        aside.write_bytes(save(tensors, metadata={"model": model}))


def load_estimator(estimator: Estimator, path: Path, name: str, digest: str | None = None) -> None:
    """Restore `estimator` from a file, which has this digest if one is given.

    Raises ValueError where the file is damaged or holds another model.
    """
    wanted = estimator.state_dict()
    size = sum(value.numel() * value.element_size() for value in wanted.values())
    try:
        with open_regular(path) as opened:
            if os.fstat(opened.fileno()).st_size > size + HEADER:
                raise ValueError("larger than the model of the config")
        if digest is not None and digest_of(path) != digest:
            raise ValueError("not the file that the run wrote")
        with safe_open(path, framework="pt") as file:
            stored, built = _model_of(file.metadata() or {})
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, *PARSER_ERRORS) as error:
        raise ValueError(f"checkpoint {path} cannot be read ({error}); repeat the run") from None
    if stored != name:
        raise ValueError(f"checkpoint {path} holds the model {stored!r}; expected {name!r}")
    require_same(built, built_with(estimator), path)
    if not wanted:
        tensors.pop("empty", None)
    tensors = estimator.todays_weights(tensors)
    for key in estimator.later:
        tensors.setdefault(key, wanted[key])
    differ = sorted(set(wanted) ^ set(tensors)) or [
        f"{key} {tuple(tensors[key].shape)} for {tuple(value.shape)}"
        for key, value in wanted.items()
        if tensors[key].shape != value.shape or tensors[key].dtype != value.dtype
    ]
    if differ:
        raise ValueError(
            f"checkpoint {path} does not fit the config of its folder: {', '.join(differ)}; "
            "take both from the same run"
        )
    for key, value in wanted.items():
        if not tensors[key].isfinite().all() and value.isfinite().all():  # others wait for a fit
            raise ValueError(f"checkpoint {path}: {key} is not finite; repeat the run")
    estimator.load_state_dict(tensors)


def require_built(path: Path, model: Mapping[str, Any], sensors: Sensors) -> None:
    """Raise ValueError where weights are of other settings than a config, or of other channels.

    Asked before a model is built: the sizes in a config may be anything, those of weights take
    room. Older files do not say what they were built with.
    """
    try:
        with open_regular(path) as opened:
            if int.from_bytes(opened.read(8), "little") > HEADER:  # where its length stands
                raise ValueError(f"its header is larger than {HEADER} bytes")
        with safe_open(path, framework="pt") as file:
            built = _model_of(file.metadata() or {})[1]
    except (SafetensorError, OSError, *PARSER_ERRORS) as error:
        raise ValueError(f"checkpoint {path} cannot be read ({error}); repeat the run") from None
    dofs = sensors.dofs
    if "dofs" in model:  # some of which may have no sensor
        dofs = model["dofs"] or sensors.highest
    channels = {"dofs": dofs, "inputs": sensors.inputs, "dt": sensors.dt}
    said = {key: value for key, value in model.items() if isinstance(value, bool | int | float)}
    require_same(built, said | channels, path)


def _model_of(metadata: dict[str, str]) -> tuple[Any, Any]:
    """Name and arguments of the stored model; older files hold the name alone."""
    words = metadata.get("model", "")
    content = json.loads(words) if words.startswith("{") else {"name": words}
    return content.get("name"), content.get("built", {})


def require_same(stored: Any, own: dict[str, Any], path: Path) -> None:
    """Raise ValueError where the weights were stored by a model of other settings."""
    for name, value in own.items():
        if isinstance(stored, dict) and name in stored and not _agree(stored[name], value):
            raise ValueError(
                f"checkpoint {path} was stored with {name}={shown(stored[name])}; this model has "
                f"{name}={shown(value)}: take weights and config from the same run"
            )


def _agree(one: Any, other: Any) -> bool:
    if isinstance(one, dict) and isinstance(other, dict):
        return all(_agree(one[name], other[name]) for name in one.keys() & other.keys())
    if isinstance(one, float) and isinstance(other, float | int):
        return math.isclose(one, other, rel_tol=1e-9)
    return bool(one == other)
