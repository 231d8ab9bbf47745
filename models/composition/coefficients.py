"""Coefficients of a composition: learned numbers in physical units, and how they are numbered.

Every coefficient of the equation of motion depends on one free parameter at most. The compiled run
takes each as a `Part`: its value, the number of that parameter and the slope by it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor, nn

LARGEST_EXPONENT = 12.0
PART = ("value", "index", "slope")


class Coefficients(nn.Module):
    """Physical coefficients of a given shape: unit·θ, or unit·exp θ where they are `positive`.

    A unit is set by `start` from the data, so that every θ is of the order of one.
    """

    unit: Tensor
    begin: Tensor
    end: Tensor

    def __init__(self, *shape: int, positive: bool = False, learned: bool = True) -> None:
        super().__init__()
        self.positive, self.learned = positive, learned
        zeros = torch.zeros(shape, dtype=torch.float64)
        self.theta = nn.Parameter(zeros, requires_grad=learned)
        self.register_buffer("unit", torch.ones(shape, dtype=torch.float64))
        for name in ("begin", "end"):  # θ without data: before the last stage, and in it
            self.register_buffer(name, torch.zeros(shape, dtype=torch.float64), persistent=False)

    @torch.no_grad()
    def start(self, unit: Tensor, theta: Tensor | float = 0.0) -> None:
        self.unit.copy_(unit)
        self.theta.copy_(torch.as_tensor(theta).expand_as(self.theta))
        self.begin.copy_(self.theta)
        self.end.copy_(self.theta)

    def deviation(self, last: bool) -> Tensor:
        """θ less its value without data, in the `last` stage of training or before."""
        return self.theta - (self.end if last else self.begin)

    def forward(self) -> Tensor:
        if self.positive:
            return self.unit * self.theta.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT).exp()
        return self.unit * self.theta

    def slope(self) -> Tensor:
        """Derivative of each value by its θ."""
        return self().detach() if self.positive else self.unit


@dataclass(frozen=True)
class Part:
    """Values, the number of the parameter behind each value (−1: none), and the slope by it."""

    value: Tensor
    index: Tensor
    slope: Tensor

    @staticmethod
    def fixed(value: Tensor) -> Part:
        return Part(value, torch.full_like(value, -1, dtype=torch.int64), torch.zeros_like(value))

    @staticmethod
    def stack(parts: list[Part], dim: int) -> Part:
        return Part(*(torch.stack([getattr(p, k) for p in parts], dim=dim) for k in PART))

    @staticmethod
    def cat(parts: list[Part], dim: int) -> Part:
        return Part(*(torch.cat([getattr(p, k) for p in parts], dim=dim) for k in PART))

    def map(self, change: Callable[[Tensor], Tensor]) -> Part:
        return Part(*(change(getattr(self, k)) for k in PART))


class Numbering:
    """Numbers of the free parameters of a module, in the order of `named_parameters`."""

    def __init__(self, module: nn.Module) -> None:
        self.first: dict[int, int] = {}
        self.count = 0
        for parameter in module.parameters():
            if parameter.requires_grad:
                self.first[id(parameter)] = self.count
                self.count += parameter.numel()

    def part(self, coefficients: Coefficients) -> Part:
        theta, value = coefficients.theta, coefficients()
        if id(theta) not in self.first:
            return Part.fixed(value)
        numbers = torch.arange(theta.numel(), device=theta.device).reshape(theta.shape)
        return Part(value, numbers + self.first[id(theta)], coefficients.slope())
