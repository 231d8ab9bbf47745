"""A run's folder: what is written, in which order, and how it is read back.

config.yaml        every choice, resolved; with the code, all that is needed to repeat the run
model.safetensors  the identified estimator
tensorboard/       scalars and figures
metrics.json       the numbers; written last and at once, so a run that has it is finished
training.ckpt      half-done training, to go on from; gone once the run is finished
failed.json        in a sweep: why there are no numbers
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from functools import cache
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from models.training.resume import belongs

CONFIG, CHECKPOINT, METRICS = "config.yaml", "model.safetensors", "metrics.json"
FAILED = "failed.json"  # why a run of a sweep has no metrics.json
PROGRESS = "training.ckpt"
INERT = ("figures", "checkpoint_seconds")  # they change no number,
INERT_TRAINER = ("enable_progress_bar", "log_every_n_steps")  # nor do these of the trainer
ROOT = Path(__file__).parent.parent


def plain(cfg: DictConfig) -> dict[str, Any]:
    """A config's values, resolved, without Hydra's own."""
    content = {}
    for key in (str(key) for key in cfg if key != "hydra"):  # a masked copy would be slow
        value = cfg[key]
        content[key] = (
            OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
        )
    return content


def settings_of(node: DictConfig) -> dict[str, Any]:
    """A choice's values without its name."""
    return {key: value for key, value in plain(node).items() if key not in ("name", "_target_")}


def config_digest(content: dict[str, Any]) -> str:
    """Ten characters that tell runs apart: a hash of every choice that can change a number."""
    content = {k: v for k, v in content.items() if k not in INERT}
    content["trainer"] = {k: v for k, v in content["trainer"].items() if k not in INERT_TRAINER}
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


def name_of(content: dict[str, Any]) -> str:
    """Folder within a sweep of the run with these resolved values."""
    names = (content[part]["name"] for part in ("model", "system", "scenario"))
    return "-".join((*names, f"seed{content['seed']}", config_digest(content)))


def run_name(cfg: DictConfig) -> str:
    return name_of(plain(cfg))


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


def identity_of(content: dict[str, Any]) -> dict[str, str]:
    """What a run's numbers follow from: its resolved values and the code."""
    return {"config": config_digest(content), "code": code_version()}


def begin_run(folder: Path, config: str, identity: dict[str, str]) -> Path | None:
    """Start a run in a folder: the text of its config, no results yet.

    Returns where training goes on, if this very run was broken off in it. Raises OSError where the
    folder cannot be written to.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (METRICS, CHECKPOINT, FAILED):
        (folder / name).unlink(missing_ok=True)
    progress = folder / PROGRESS
    if not belongs(progress, identity):
        progress.unlink(missing_ok=True)
        shutil.rmtree(folder / "tensorboard", ignore_errors=True)
    write_text(folder / CONFIG, config)
    return progress if progress.exists() else None


def finish_run(folder: Path, metrics: dict[str, Any]) -> None:
    """Write the numbers, which makes the run a finished one."""
    write_json(folder / METRICS, metrics)
    (folder / PROGRESS).unlink(missing_ok=True)


def write_failure(folder: Path, cfg: DictConfig | None, reason: str, trace: str, own: bool) -> None:
    """Why a run of a sweep has no numbers; `own`: it would fail again, wherever it is run."""
    folder.mkdir(parents=True, exist_ok=True)
    if cfg is not None:
        write_text(folder / CONFIG, config_text(cfg))
    content = {"reason": reason, "own": own, "code": code_version(), "trace": trace}
    write_json(folder / FAILED, content)


def read_failure(folder: Path) -> dict[str, Any]:
    """What `write_failure` wrote."""
    failure: dict[str, Any] = json.loads((folder / FAILED).read_text("utf-8"))
    return failure


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
