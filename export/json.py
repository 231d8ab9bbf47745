"""Parameters of a model with names, values and units, and its passport, as JSON."""

from __future__ import annotations

import importlib
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from torch import nn

from export.run import Exported
from models.composition.coefficients import Coefficients


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME.json: parameters, channels, time step, hold, passport."""
    path = folder / f"{model.name}.json"
    text = json.dumps(content_of(model), indent=2, ensure_ascii=False, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
    return [path]


def content_of(model: Exported) -> dict[str, Any]:
    """What the file holds. Numbers that are not finite are null."""
    return {
        "model": model.name,
        "dt_s": model.estimator.dt,
        "hold": model.hold,
        "inputs": [{"name": name, "unit": unit} for name, unit in model.inputs],
        "dofs": model.estimator.dofs,
        "parameters": [
            {"name": name, "value": value if math.isfinite(value) else None, "unit": unit}
            for name, value, unit in parameters(model.estimator)
        ],
        "settings": _plain(model.config),
        "passport": model.passport.facts,
    }


def parameters(estimator: nn.Module) -> Iterable[tuple[str, float, str]]:
    """Name, value and unit of each parameter: as an engineer names them, where that is known."""
    try:
        physical = importlib.import_module("export.physical")
    except ModuleNotFoundError:
        yield from _numbers(estimator)
        return
    for parameter in physical.parameters_of(estimator):
        yield parameter.name, float(parameter.value), parameter.unit


def _numbers(estimator: nn.Module) -> Iterable[tuple[str, float, str]]:
    """Coefficients by the names that the model gives them, in SI units that are not told."""
    taken = set()
    for name, module in estimator.named_modules():
        if isinstance(module, Coefficients):
            taken |= {f"{name}.{inner}" for inner, _ in module.named_parameters()}
            yield from _entries(name, module().detach().flatten().tolist())
    for name, values in estimator.named_parameters():
        if name not in taken:
            yield from _entries(name, values.detach().flatten().tolist())


def _entries(name: str, values: list[float]) -> Iterable[tuple[str, float, str]]:
    for i, value in enumerate(values):
        yield (name if len(values) == 1 else f"{name}[{i + 1}]"), value, ""


def _plain(value: Any) -> Any:
    """Lists and mappings of a config as JSON has them."""
    if hasattr(value, "items"):
        return {str(key): _plain(inner) for key, inner in value.items()}
    if hasattr(value, "__iter__") and not isinstance(value, str):
        return [_plain(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
