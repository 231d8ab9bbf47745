"""Where a run is computed: on the processor, or on a GPU.

Everything is in double precision, which Apple's GPUs do not have: a GPU is one of CUDA's.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import torch

from models.estimator import Estimator


def accelerator_of(trainer: Mapping[str, Any], estimator: Estimator) -> str:
    """`cpu` or `cuda`: what Lightning's Trainer takes, and PyTorch; says where a GPU is not used.

    trainer: settings of that Trainer. Raises ValueError for a GPU that PyTorch does not find.
    """
    chosen, found = trainer.get("accelerator") or "cpu", torch.cuda.is_available()
    if chosen == "cpu" or (chosen == "auto" and not found):
        return "cpu"
    require_accelerator(trainer)
    if estimator.on_processor:
        print(
            f"trainer.accelerator={chosen} is not used: compiled code of the processor does the "
            f"work of {type(estimator).__name__}",
            file=sys.stderr,
        )
        return "cpu"
    return "cuda"


def require_accelerator(trainer: Mapping[str, Any]) -> None:
    """Raise ValueError for a GPU that PyTorch does not find."""
    chosen = trainer.get("accelerator") or "cpu"
    if chosen in ("gpu", "cuda") and not torch.cuda.is_available():
        raise ValueError(
            f"trainer.accelerator={chosen}: PyTorch finds no GPU with CUDA on this machine; "
            "choose trainer=cpu, or install a PyTorch with its drivers"
        )
