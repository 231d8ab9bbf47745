"""The stream that is measured: a VWNN of 3 DOFs and 91 features under recursive least squares."""

from __future__ import annotations

import torch

from data.sample import Sample
from models.online.laws.recursive_least_squares import RecursiveLeastSquares
from models.online.stream import Stream
from models.online.vwnn_stream import VWNNStream
from models.training.assemble import data_from
from models.vwnn import VWNN
from runner.config.compose import composed

DT = 1e-3  # [s]
FORGETTING = 0.999


def motion(duration: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Accelerations and forces (T, 3) of the paper's yielding frame at 1 kHz."""
    cfg = composed("system=bilinear", f"data.dt={DT}", f"data.duration={duration}")
    data = data_from(cfg)
    data.setup()
    record = data.records["train"][0]
    return record.a, record.f


def samples_from(a: torch.Tensor, f: torch.Tensor) -> list[Sample]:
    return [Sample(f=u, a=y) for y, u in zip(a, f, strict=True)]


def new_stream(kind: type[Stream] = VWNNStream) -> Stream:
    return kind(VWNN(3, 3, DT), RecursiveLeastSquares(FORGETTING))
