"""Two masses in short motion, and small models of them that are trained on free runs."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from data.record import Drive, Record, Response, stack
from models.estimator import Estimator
from models.fit.trainable import Trainable
from models.mlp import GlobalMLP, ResidualMLP
from models.neural_state_space import NeuralStateSpace

DT = 0.01
MODELS = {
    "global": lambda: GlobalMLP(2, 2, DT, hidden=(3,)),
    "residual": lambda: ResidualMLP(2, 2, DT, hidden=(3,)),
    "state_space": lambda: NeuralStateSpace(2, 2, DT, memory=2, hidden=3, past=4),
}


class Growth(Trainable):
    """ẍ = g ẋ + f with a single g: above zero, a run grows without bound."""

    reads = ("x", "v", "f")

    def __init__(self, gain: float) -> None:
        super().__init__(2, 2, DT)
        self.gain = nn.Parameter(torch.tensor(gain, dtype=torch.float64))

    def free_run(self, drive: Drive) -> Response:
        x, v, history = drive.x0, drive.v0, []
        for u in drive.u.unbind(dim=-2):
            a = self.gain * v + u
            history.append((x, v, a))
            x, v = x + DT * v, v + DT * a
        return Response(*(torch.stack(s, dim=-2) for s in zip(*history, strict=True)))


def motion(samples: int = 40, seed: int = 0, begins: str = "rest") -> Record:
    """Two masses under smooth random forces, from rest (or as given), by small Euler steps."""
    rng = np.random.default_rng(seed)
    f = np.cumsum(rng.standard_normal((samples, 2)), axis=0)
    x, v, history = np.zeros(2), np.zeros(2), []
    for u in f:
        a = u - 90.0 * x - 1.5 * v - 2000.0 * x**3
        history.append((x, v, a))
        v = v + DT * a
        x = x + DT * v
    x, v, a = (torch.from_numpy(np.stack(s)) for s in zip(*history, strict=True))
    return Record(DT, a, torch.from_numpy(f), x, v, initial_state=begins)


def identified(model: str, record: Record) -> Estimator:
    torch.manual_seed(3)
    estimator = MODELS[model]()
    estimator.identify([record])
    return estimator


def free_of(estimator: Estimator) -> list[nn.Parameter]:
    return [p for p in estimator.parameters() if p.requires_grad]


RECORDS = {
    "record": motion,
    "in_motion": lambda: motion(70).window(30, 40, warmup=5),
    "batch": lambda: stack([motion(), motion(seed=1)]),
}
