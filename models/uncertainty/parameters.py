"""The free parameters of an estimator as one vector, in the order of the compiled Jacobian."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import torch
from torch import Tensor, nn

from models.estimator import Estimator

STEP = 1e-6  # of θ, which is of the order of one, in central differences


def free_vector(module: nn.Module) -> Tensor:
    """θ (P,): copies of all parameters that ask for a gradient."""
    free = [p.detach().reshape(-1) for p in module.parameters() if p.requires_grad]
    return torch.cat(free).clone() if free else torch.zeros(0, dtype=torch.float64)


@torch.no_grad()
def set_free_vector(module: nn.Module, theta: Tensor) -> None:
    """Set all parameters that ask for a gradient from θ (P,)."""
    first = 0
    for parameter in module.parameters():
        if parameter.requires_grad:
            count = parameter.numel()
            parameter.copy_(theta[first : first + count].view_as(parameter))
            first += count


def values_of(estimator: Estimator, names: Iterable[str]) -> list[float]:
    """Of physical parameters; NaN of those that there are none of."""
    now = {p.name: p.value for p in estimator.physical_parameters()}
    return [now.get(name, math.nan) for name in names]


@torch.no_grad()
def slopes(module: nn.Module, values: Callable[[], Sequence[float]]) -> Tensor:
    """∂values/∂θ (Q, P) by central differences. θ is as before when it returns."""
    columns = []
    for parameter in (p for p in module.parameters() if p.requires_grad):
        theta = parameter.view(-1)
        for j, here in enumerate(theta.tolist()):
            ends = []
            try:
                for step in (STEP, -STEP):
                    theta[j] = here + step
                    ends.append(torch.tensor(values(), dtype=torch.float64))
            finally:
                theta[j] = here
            columns.append((ends[0] - ends[1]) / (2.0 * STEP))
    return torch.stack(columns, dim=1) if columns else torch.zeros(len(values()), 0).double()
