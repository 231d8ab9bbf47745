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
def slopes(
    module: nn.Module, values: Callable[[], Sequence[float]], among: Iterable[int] | None = None
) -> Tensor:
    """∂values/∂θ (Q, P) by central differences; nil where θ is none `among` those of these numbers.

    θ is as before when it returns.
    """
    theta = free_vector(module)
    found = torch.zeros(len(values()), len(theta), dtype=torch.float64)
    try:
        for j in range(len(theta)) if among is None else among:
            ends = []
            for step in (STEP, -STEP):
                moved = theta.clone()
                moved[j] += step
                set_free_vector(module, moved)
                ends.append(torch.tensor(values(), dtype=torch.float64))
            found[:, j] = (ends[0] - ends[1]) / (2.0 * STEP)
    finally:
        set_free_vector(module, theta)
    return found
