"""Parameters of a model with names, values and units, its modes and its passport, as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from export.modes import modes_of
from export.names import plain_values
from export.run import Exported
from models.estimator import Estimator
from runner.scores.headline import interval_in


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME.json: parameters, modes, channels, time step, hold, passport."""
    path = folder / f"{model.name}.json"
    text = json.dumps(content_of(model), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return [path]


def content_of(model: Exported) -> dict[str, Any]:
    """What the file holds. Numbers that are not finite are null."""
    content = {
        "model": model.name,
        "dt_s": model.estimator.dt,
        "hold": model.hold,
        "inputs": [{"name": name, "unit": unit} for name, unit in model.inputs],
        "dofs": model.estimator.dofs,
        "parameters": [
            p | interval_in(model.intervals.get(p["name"])) for p in parameters(model.estimator)
        ],
        "common_factor_is_open": model.estimator.scale_is_open,
        "modes": [*modes(model.estimator)],
        "settings": model.config,
        "passport": model.passport.facts,
    }
    return plain_values(content)


def parameters(estimator: Estimator) -> Iterable[dict[str, Any]]:
    """Physical parameters of a model; of a black box the numbers as the model names them."""
    physical: list[dict[str, Any]] = [
        vars(parameter) for parameter in estimator.physical_parameters()
    ]
    named: Iterable[dict[str, Any]] = (
        {"name": name, "value": value, "unit": ""} for name, value in _numbers(estimator)
    )
    for one in physical or named:
        yield {**one, "value": one["value"] if math.isfinite(one["value"]) else None}


def modes(estimator: Estimator) -> Iterable[dict[str, Any]]:
    """Modes of small motions, of models that have masses and springs or their like."""
    found = modes_of(estimator)
    if found is None:
        return
    for f, d, shape in zip(found.frequencies, found.damping, found.shapes.T, strict=True):
        yield {
            "frequency_hz": float(f),
            "damping_ratio": float(d),
            "shape_real": shape.real.tolist(),
            "shape_imaginary": shape.imag.tolist(),
        }


def _numbers(estimator: Estimator) -> Iterable[tuple[str, float]]:
    """Every weight by the name that the model gives it."""
    for name, values in estimator.named_parameters():
        for i, value in enumerate(values.detach().flatten().tolist()):
            yield (name if values.numel() == 1 else f"{name}[{i + 1}]"), value
