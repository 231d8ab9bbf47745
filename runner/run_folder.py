"""A run's folder: what is written, in which order, and how it is read back.

config.yaml        every choice, resolved; with the code, all that is needed to repeat the run
sensors.json       time step, DOFs and channels: what a model is rebuilt for, without its records
model.safetensors  the identified estimator
tensorboard/       scalars and figures
metrics.json       the numbers; written last, so a run that has it is finished
training.ckpt      half-done training, to go on from; gone once the run is finished
failed.json        in a sweep: why there are no numbers
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import torch
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException
from yaml import YAMLError

from data.sample import Sensors
from models.checkpoint import load_estimator, save_estimator
from models.estimator import Estimator
from models.training.assemble import data_from, estimator_from
from models.training.resume import belongs
from runner.identity import code_version, config_digest, front_name, identity_of, targets_of

CONFIG, CHECKPOINT, METRICS = "config.yaml", "model.safetensors", "metrics.json"
SENSORS = "sensors.json"
FAILED = "failed.json"  # why a run of a sweep has no metrics.json
PROGRESS = "training.ckpt"


@dataclass(frozen=True)
class Run:
    """A run that is being made: its folder and its resolved values."""

    folder: Path
    choices: dict[str, Any]

    @classmethod
    def begin(cls, folder: Path, cfg: DictConfig, sensors: Sensors) -> Run:
        """Start a run in a folder, which has no results from now on.

        Raises OSError where the folder cannot be written to.
        """
        run = cls(folder, plain(cfg))
        run.start(config_text(cfg), sensors)
        return run

    @cached_property
    def identity(self) -> dict[str, str]:
        return identity_of(self.choices)

    def start(self, config: str, sensors: Sensors) -> None:
        """Write what is known beforehand, the text of config.yaml last; earlier results go."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for name in (METRICS, CHECKPOINT, FAILED):
            (self.folder / name).unlink(missing_ok=True)
        if not belongs(self.progress, self.identity):
            self.progress.unlink(missing_ok=True)
            shutil.rmtree(self.folder / "tensorboard", ignore_errors=True)
        write_json(self.folder / SENSORS, asdict(sensors))
        write_text(self.folder / CONFIG, config)

    @property
    def progress(self) -> Path:
        """Where half-done training is saved."""
        return self.folder / PROGRESS

    @property
    def unfinished(self) -> Path | None:
        """Half-done training to go on from, if this very run was broken off in it."""
        return self.progress if self.progress.exists() else None

    def save(self, estimator: Estimator) -> None:
        """Write the identified estimator."""
        save_estimator(estimator, self.folder / CHECKPOINT, self.choices["model"]["name"])

    def finish(self, metrics: dict[str, Any]) -> None:
        """Write the numbers, which makes the run a finished one."""
        write_json(self.folder / METRICS, metrics)
        self.progress.unlink(missing_ok=True)


def plain(cfg: DictConfig) -> dict[str, Any]:
    """A config's values, resolved, without Hydra's own."""
    content = {}
    for key in (str(key) for key in cfg if key != "hydra"):  # a masked copy would be slow
        value = cfg[key]
        content[key] = (
            OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value
        )
    return content


def settings_of(choice: Mapping[str, Any]) -> dict[str, Any]:
    """A choice's resolved values without its name."""
    return {key: value for key, value in choice.items() if key not in ("name", "_target_")}


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
    bound, so no estimator ran.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if cfg is not None:
        write_text(folder / CONFIG, config_text(cfg))
    code = "" if cfg is None else code_version(targets_of(plain(cfg)))
    content = {"reason": reason, "own": own, "escaped": escaped, "code": code, "trace": trace}
    write_json(folder / FAILED, content)


def read_failure(folder: Path) -> dict[str, Any]:
    """What `write_failure` wrote; in older runs the reason alone tells that a motion escaped."""
    failure: dict[str, Any] = json.loads((folder / FAILED).read_text("utf-8"))
    return {"escaped": "motion escaped at t =" in failure["reason"], **failure}


def read_metrics(folder: Path) -> dict[str, Any]:
    """Numbers of a finished run. Raises ValueError where the file holds none."""
    metrics = json.loads((folder / METRICS).read_text("utf-8"))
    if not isinstance(metrics, dict):
        raise ValueError(f"{METRICS} holds no numbers of a run")
    return metrics


def read_run(folder: Path) -> tuple[DictConfig, dict[str, Any]]:
    """Config and metrics of a finished run. Raises ValueError where there is none.

    Configs of earlier layouts, which name classes by their modules, are read as today's.
    """
    for name in (CONFIG, CHECKPOINT, METRICS):
        if not (folder / name).is_file():
            raise ValueError(
                f"{folder} is not a finished run: it has no {name}; "
                "give the folder that train.py wrote (hydra.run.dir)"
            )
    try:
        cfg = OmegaConf.load(folder / CONFIG)
        metrics = read_metrics(folder)
    except (YAMLError, OmegaConfBaseException, ValueError) as error:
        first = str(error).splitlines()[0]
        raise ValueError(f"{folder} is damaged: {first}; repeat the run") from None
    missing = {"system", "scenario", "model", "data", "excitation", "seed", "threads"} - set(cfg)
    if not isinstance(cfg, DictConfig) or missing:
        raise ValueError(f"{folder / CONFIG} lacks {', '.join(sorted(missing))}; repeat the run")
    return OmegaConf.create(_by_front(OmegaConf.to_container(cfg))), metrics


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


def sensors_of(cfg: DictConfig, folder: Path) -> Sensors:
    """What a run's model was built for; runs of earlier layouts need their records for it."""
    path = folder / SENSORS
    if not path.is_file():
        return data_from(cfg).sensors
    try:
        return Sensors(**json.loads(path.read_text("utf-8")))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} is damaged ({error}); repeat the run") from None


def restore(cfg: DictConfig, folder: Path) -> Estimator:
    """The identified estimator of a run, of the size and time step it was identified with.

    Its records are not looked at: they may be gone.
    """
    torch.set_num_threads(cfg.threads)  # the same threads, the same bits
    estimator = estimator_from(cfg.model, sensors_of(cfg, folder))
    load_estimator(estimator, folder / CHECKPOINT, cfg.model.name)
    return estimator.eval()
