"""A finished run becomes an entry of the zoo; nothing that is published is ever written again."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from omegaconf import DictConfig

from data.plain_data import read_text, read_yaml
from data.record import Record
from data.regular_file import digest_of
from data.simulation.datamodule import SimulatedData
from data.whole_file import write_text
from models.estimator import Estimator
from models.training.assemble import data_from
from models.fit.metrics import LEFT
from models.zoo.golden import golden_of
from models.zoo.index import FORMAT, INDEX, NAME, ROOT, entries
from report.about import colour_of, prior_knowledge
from report.zoo.card import Card
from report.zoo.entry_config import (
    command_of,
    entry_config,
    folders_of,
    require_command,
    without_folders,
)
from report.zoo.licence import Licence
from report.zoo.picture import picture_of
from report.zoo.scores import is_simulated, over_seeds
from runner.folder.run import restore, sensors_of
from runner.folder.run_folder import read_run

TRAINING = ("solver", "iterations", "stopped")  # what is kept of it; stages are a log


def publish(
    run: Path, name: str | None, licence: Licence, command: str | None = None, root: Path = ROOT
) -> str:
    """Add a finished run to the zoo; returns the name MODEL/SYSTEM.vN that it got.

    Without a version the next free one is taken. command: of train.py, which makes the run again;
    None: found from its config. Raises ValueError for a folder without a finished run, a model that
    identified nothing, a version that is published, weights that are, and measured records without
    a licence.
    """
    cfg, metrics = read_run(run)
    if metrics.get("verdict", {}).get("identified") is False:
        raise ValueError(f"{run} identified nothing: {metrics['verdict']['reason']}")
    if not is_simulated(cfg) and licence.data == Licence.data:
        raise ValueError(f"{run} is of measured records: say data_licence=… and source=…")
    full = _versioned(name or f"{cfg.model.name}/{cfg.system.name}", run, root)
    values = entry_config(cfg)
    command = command or command_of(values)
    require_command(command, values)
    model = restore(cfg, run).requires_grad_(False)
    records = _records(cfg)
    aside = root / full.replace(full.rpartition("/")[2], f".part-{os.getpid()}")
    aside.mkdir(parents=True)
    try:
        _write(aside, full, run, cfg, values, metrics, model, records, licence, command)
        aside.rename(root / full)
    except BaseException:
        shutil.rmtree(aside, ignore_errors=True)
        raise
    write_index(root, {full: facts_of(root / full, licence)})
    return full


def _versioned(name: str, run: Path, root: Path) -> str:
    """The name with a version that is free."""
    plain = f"{name}.v1" if ".v" not in name else name
    if not NAME.fullmatch(plain):
        raise ValueError(f"{name}: expected MODEL/SYSTEM or MODEL/SYSTEM.vN, in letters and digits")
    known = {entry.name: entry for entry in entries(root)}
    if ".v" in name:
        if name in known or (root / name).exists():
            raise ValueError(f"{name} is published, and never changes; leave the version out")
        return name
    same = [entry for entry in known.values() if f"{entry.model}/{entry.system}" == name]
    own = digest_of(run / "model.safetensors")
    for entry in same:
        if entry.facts["files"]["model.safetensors"]["sha256"] == own:
            raise ValueError(f"{entry.name} has these weights; there is nothing new to publish")
    return f"{name}.v{max((entry.version for entry in same), default=0) + 1}"


def _records(cfg: DictConfig) -> list[Record]:
    """Test records of a run, one by one."""
    data = data_from(cfg)
    if isinstance(data, SimulatedData):
        return data.simulation.records("test", data.test_records, cfg.seed, data.train_records)[0]
    data.setup()
    return data.records["test"]


def _write(
    folder: Path,
    name: str,
    run: Path,
    cfg: DictConfig,
    values: dict[str, Any],
    metrics: Mapping[str, Any],
    model: Estimator,
    records: list[Record],
    licence: Licence,
    command: str,
) -> None:
    """All files of an entry."""
    shutil.copyfile(run / "model.safetensors", folder / "model.safetensors")
    text = yaml.safe_dump(
        values, sort_keys=False, allow_unicode=True, width=1000, default_flow_style=None
    )
    (folder / "config.yaml").write_text(text, encoding="utf-8")
    require_same_values(folder / "config.yaml", values)
    sensors = sensors_of(cfg, run)
    kept = {key: value for key, value in metrics.items() if value not in ({}, [])}
    kept["training"] = {k: v for k, v in metrics.get("training", {}).items() if k in TRAINING}
    if is_simulated(cfg):
        kept["over_seeds"] = over_seeds(model, cfg)
    kept = without_folders(kept, folders_of(cfg))
    write_compact(folder / "metrics.json", kept)
    write_compact(folder / "sensors.json", vars(sensors))
    record = records[0]
    bound = LEFT * float(record.a.abs().max()) / 10.0
    golden = golden_of(model, record.excitation, record.hold, bound)
    np.savez_compressed(folder / "golden.npz", allow_pickle=False, **golden)
    picture = picture_of(model, record, colour_of(str(cfg.model.name)))
    (folder / "picture.svg").write_text(picture, encoding="utf-8")
    card = Card(name, cfg, kept, sensors, type(model).__name__, licence, command, record)
    (folder / "card.md").write_text(card.text(), encoding="utf-8")


def require_same_values(path: Path, values: Mapping[str, Any]) -> None:
    """Raise ValueError where a config is read back as something else."""
    if read_yaml(read_text(path)) != values:
        raise ValueError(f"{path} cannot be read back as it was written")


def write_compact(path: Path, content: Mapping[str, Any]) -> None:
    """JSON without spaces: an entry is small."""
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    write_text(path, text + "\n")


def facts_of(folder: Path, licence: Licence) -> dict[str, Any]:
    """What the index says of an entry."""
    metrics = json.loads((folder / "metrics.json").read_text("utf-8"))
    free = metrics["free_run"]
    free_percent = free.get("relative_rms_percent")
    return {
        "free_run_percent": "none" if "none" in free else free_percent or "diverges",
        "one_step_percent": metrics["test"]["relative_rms_percent"],
        "parameters": metrics["parameters"],
        "quantity": metrics["quantity"],
        "licence": licence.weights,
        "data_licence": licence.data,
        "files": {
            path.name: {"sha256": digest_of(path), "bytes": path.stat().st_size}
            for path in sorted(folder.iterdir())
        },
    }


def write_index(root: Path, new: Mapping[str, Any]) -> None:
    """The index with new entries added."""
    known = {entry.name: dict(entry.facts) for entry in entries(root)}
    found = dict(sorted((known | dict(new)).items()))
    models = dict.fromkeys(name.partition("/")[0] for name in found)
    content = {
        "format": FORMAT,
        "told": {model: " ".join(prior_knowledge(model).split()) for model in models},
        "entries": found,
    }
    write_compact(root / INDEX, content)


def total_bytes(root: Path = ROOT) -> int:
    """Size of everything that is published, the index too."""
    return sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
