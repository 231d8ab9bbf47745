"""A model's free run as an ONNX graph: a Scan over time, in double precision.

Inputs u (B, T, m), x0 and v0 (B, n), outputs x, v, a (B, T, n). ONNX Runtime takes some hundred
microseconds a sample for such loops: for speed take the target c.
"""

from __future__ import annotations

import importlib
import json
import logging
import warnings
from pathlib import Path
from typing import Any

import torch

from export.graphs.choose import program_of
from export.run import Exported


def write(model: Exported, folder: Path) -> list[Path]:
    """NAME.onnx. Raises ValueError for a model that has no graph, ModuleNotFoundError."""
    onnx, _ = (importlib.import_module(name) for name in ("onnx", "onnxscript"))  # before the work
    program, path = program_of(model), folder / f"{model.name}.onnx"
    graph: Any = _converted(program).model_proto
    facts = {
        "passport": json.dumps(model.passport.facts),
        "dt_s": repr(model.estimator.dt),
        "hold": model.hold,
        "inputs": json.dumps(model.inputs),
    }
    onnx.helper.set_model_props(graph, facts)
    graph.doc_string = "\n".join(model.lines())
    onnx.save(graph, path)
    return [path]


def _converted(program: torch.export.ExportedProgram) -> Any:
    """The program in ONNX's operators, without PyTorch's words on the way."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            names: dict[str, Any] = {
                "input_names": ["u", "x0", "v0"],
                "output_names": ["x", "v", "a"],
            }
            return torch.onnx.export(program, (), dynamo=True, verbose=False, **names)
    finally:
        logger.setLevel(level)
