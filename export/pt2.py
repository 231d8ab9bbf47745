"""A model's free run as a program of torch.export: PyTorch runs it without this project.

program = torch.export.load("NAME.pt2", extra_files=(facts := {"passport.json": ""})).module()
x, v, a = program(u, x0, v0)      u (B, T, m), x0 and v0 (B, n), x, v, a (B, T, n), float64
"""

from __future__ import annotations

import json
from pathlib import Path

import torch

from export.graphs.choose import program_of
from export.run import Exported


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME.pt2. Raises ValueError for a model that has no graph."""
    path = folder / f"{model.name}.pt2"
    passport = json.dumps({**model.passport.facts, "inputs": model.inputs, "hold": model.hold})
    torch.export.save(program_of(model), path, extra_files={"passport.json": passport})
    return [path]
