"""A run's folder: what is written, in which order, and how it is read back.

config.yaml        every choice, resolved; with the code, all that is needed to repeat the run
model.safetensors  the identified estimator
tensorboard/       scalars and figures
metrics.json       the numbers; written last and at once, so a run that has it is finished
"""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

CONFIG, CHECKPOINT, METRICS = "config.yaml", "model.safetensors", "metrics.json"
FAILED = "failed.txt"  # why a run of a sweep has no metrics.json
INERT = ("enable_progress_bar", "log_every_n_steps")  # of the trainer: they change no number
ROOT = Path(__file__).parent.parent


def plain(cfg: DictConfig) -> dict[str, Any]:
    """A config's values, resolved, without Hydra's own."""
    keys = [str(key) for key in cfg if key != "hydra"]
    masked: Any = OmegaConf.masked_copy(cfg, keys)
    content: dict[str, Any] = OmegaConf.to_container(masked, resolve=True)  # type: ignore[assignment]
    return content


def settings_of(node: DictConfig) -> dict[str, Any]:
    """A choice's values without its name."""
    return {key: value for key, value in plain(node).items() if key not in ("name", "_target_")}


def config_digest(cfg: DictConfig) -> str:
    """Ten characters that tell runs apart: a hash of every choice that can change a number."""
    content = plain(cfg)
    content.pop("figures")
    content["trainer"] = {k: v for k, v in content["trainer"].items() if k not in INERT}
    text = json.dumps(content, sort_keys=True, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()[:10]


@cache
def code_version() -> str:
    """Ten characters that change with the code of data and models."""
    digest = hashlib.sha256()
    for folder in ("data", "models"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:10]


def run_name(cfg: DictConfig) -> str:
    """Folder of a run within a sweep."""
    names = (cfg.model.name, cfg.system.name, cfg.scenario.name)
    return "-".join((*names, f"seed{cfg.seed}", config_digest(cfg)))


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    aside = path.with_name(path.name + ".part")
    aside.write_text(text, encoding="utf-8")
    os.replace(aside, path)


def write_json(path: Path, content: dict[str, Any]) -> None:
    write_text(path, json.dumps(content, indent=2, allow_nan=False) + "\n")


def begin_run(folder: Path, cfg: DictConfig) -> None:
    """Start a run in a folder: a config, no results yet. Raises ValueError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in (METRICS, CHECKPOINT, FAILED):
            (folder / name).unlink(missing_ok=True)
        write_text(folder / CONFIG, OmegaConf.to_yaml(cfg, resolve=True))
    except OSError as error:
        raise ValueError(
            f"cannot write to {folder} ({error.strerror}); choose another hydra.run.dir"
        ) from None


def finish_run(folder: Path, metrics: dict[str, Any]) -> None:
    """Write the numbers, which makes the run a finished one."""
    write_json(folder / METRICS, metrics)


def read_run(folder: Path) -> tuple[DictConfig, dict[str, Any]]:
    """Config and metrics of a finished run. Raises ValueError where there is none."""
    for name in (CONFIG, CHECKPOINT, METRICS):
        if not (folder / name).is_file():
            raise ValueError(
                f"{folder} is not a finished run: it has no {name}; "
                "give the folder that train.py wrote (hydra.run.dir)"
            )
    try:
        cfg = OmegaConf.load(folder / CONFIG)
        metrics = json.loads((folder / METRICS).read_text(encoding="utf-8"))
    except (YAMLError, OmegaConfBaseException, ValueError) as error:
        first = str(error).splitlines()[0]
        raise ValueError(f"{folder} is damaged: {first}; repeat the run") from None
    missing = {"system", "scenario", "model", "data", "excitation", "seed", "threads"} - set(cfg)
    if not isinstance(cfg, DictConfig) or missing:
        raise ValueError(f"{folder / CONFIG} lacks {', '.join(sorted(missing))}; repeat the run")
    return cfg, metrics
