"""What is done with a model or a simulation, and what must come of it."""

from __future__ import annotations

import math
import random
from typing import Any

import torch
from torch import Tensor

import models
from benchmarks.attack.attempt import WronglyAcceptedError
from data.record import Record

HUGE = 1e60  # signals beyond may overflow in products


def largest(*signals: Tensor | None) -> float:
    sizes = [float(u.detach().abs().max()) for u in signals if u is not None and u.numel()]
    return max((s for s in sizes if math.isfinite(s)), default=0.0)


def require(condition: bool, words: str) -> None:
    if not condition:
        raise WronglyAcceptedError(words)


def used(model: Any, records: list[Record], draw: random.Random) -> None:
    """Identify, estimate and simulate; what comes is as it must be."""
    model.identify(records)
    if not records:
        return  # a model that learns nothing needs none
    record = draw.choice(records)
    with torch.set_grad_enabled(draw.random() < 0.3):
        estimate = model(record)
        require(estimate.shape == record.a.shape, f"estimates {tuple(estimate.shape)}")
        require(estimate.dtype == torch.float64, f"estimates of {estimate.dtype}")
        tame = largest(record.a) > 1e-100 and largest(*record.signals().values()) < HUGE
        sound = bool(torch.isfinite(estimate).all()) or isinstance(model, models.Recurrent)
        free = isinstance(model, (models.ElementNetwork, models.LatentHysteresisNetwork,
                                  models.HystereticElement, models.BranchElement,
 models.NeuralStateSpace))  # fmt: skip
        require(sound or free or not tame, "estimates that are not finite, from signals that are")
        drive = record.drive()
        response = model.free_run(drive)
        for u in (response.x, response.v, response.a):
            require(u.shape[:-1] == record.a.shape[:-1], f"a free run of {tuple(u.shape)}")


def built(name: str, dofs: Any, inputs: Any, dt: Any, arguments: dict[str, Any]) -> Any:
    return getattr(models, name)(dofs, inputs, dt, **arguments)


def shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) < 300 else f"{text[:300]}…"


def simulated(simulation: Any) -> None:
    for split in ("train", "test"):
        records, _ = simulation.records(split, 1, 0, 0 if split == "train" else 1)
        for record in records:
            require(record.samples == simulation.samples, f"{record.samples} samples")
            for signal, u in record.signals().items():
                require(bool(torch.isfinite(u).all()), f"{signal} of a motion is not finite")
