"""An identified estimator on disk: its state_dict as safetensors, which cannot hold code."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from models.estimator import Estimator


def save_estimator(estimator: Estimator, path: Path, name: str) -> None:
    """Write `path` whole or not at all; `name` is the model's name in the config.

    Raises OSError where the disk does not take it.
    """
    tensors = {
        key: value.detach().cpu().contiguous() for key, value in estimator.state_dict().items()
    }
    tensors = tensors or {"empty": torch.zeros(0)}  # the format has no empty file
    aside = path.with_suffix(".part")
    try:
        save_file(tensors, aside, metadata={"model": name})
    except SafetensorError as error:  # "… (os error 28)"
        number = re.search(r"os error (\d+)", str(error))
        code = int(number[1]) if number else errno.EIO
        raise OSError(code, os.strerror(code), str(path)) from None
    os.replace(aside, path)


def load_estimator(estimator: Estimator, path: Path, name: str) -> None:
    """Restore `estimator` from a file.

    Raises ValueError where the file is damaged or holds another model.
    """
    try:
        with safe_open(path, framework="pt") as file:
            stored = (file.metadata() or {}).get("model")
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise ValueError(f"checkpoint {path} cannot be read ({error}); repeat the run") from None
    if stored != name:
        raise ValueError(f"checkpoint {path} holds the model {stored!r}; expected {name!r}")
    wanted = estimator.state_dict()
    if not wanted:
        tensors.pop("empty", None)
    differ = sorted(set(wanted) ^ set(tensors)) or [
        f"{key} {tuple(tensors[key].shape)} for {tuple(value.shape)}"
        for key, value in wanted.items()
        if tensors[key].shape != value.shape or tensors[key].dtype != value.dtype
    ]
    if differ:
        raise ValueError(
            f"checkpoint {path} does not fit the config beside it: {', '.join(differ)}; "
            "take both from the same run"
        )
    estimator.load_state_dict(tensors)
