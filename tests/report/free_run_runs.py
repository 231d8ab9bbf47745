"""Folders of finished runs with planted free-run scores."""

from __future__ import annotations

import json
from pathlib import Path

from omegaconf import OmegaConf

LOST = None  # the free run diverged
NO_FREE_RUN = {"no_free_run": "it looks at every sample"}


def add_run(folder: Path, free_run: float | dict | None, failed: bool = False, **choices) -> Path:
    """A run as train.py leaves it; a free run without an error has diverged."""
    case = {"model": "linear", "system": "bilinear", "scenario": "full_state", "seed": 0}
    case |= {key: choices.pop(key) for key in tuple(choices) if key in case}
    settings, records = choices.pop("settings", {}), choices.pop("train_records", 8)
    grid = choices.pop("grid", None)
    path = folder / "-".join(
        map(str, (*case.values(), records, *settings.values(), *choices.values()))
    )
    path.mkdir(parents=True)
    names = {key: {"name": case[key]} for key in ("model", "system", "scenario")}
    names["scenario"] |= settings
    names["model"] |= choices
    cfg = {**names, "seed": case["seed"], "data": {"train_records": records}, "grid": grid}
    OmegaConf.save(OmegaConf.create(cfg), path / "config.yaml")
    if failed:
        (path / "failed.json").write_text('{"reason": "the solver failed"}')
        return path
    scores = free_run
    if not isinstance(free_run, dict):
        error = {"relative_rms_percent": free_run, "relative_rms_percent_true": free_run}
        double = None if free_run is None else 2.0 * free_run
        scores = {**error, "displacement_percent": double, "diverged": int(free_run is None)}
    split = {"relative_rms_percent": 3.0, "per_dof_percent": [3.0]}
    results = {"train": split, "test": split, "free_run": scores}
    more = {"scenario_settings": settings, "fit_seconds": 0.5, "parameters": 27}
    (path / "metrics.json").write_text(json.dumps({**case, **more, **results}))
    return path
